"""MATLAB files (.mat, up to version 7): A, C of the exosystem, L, the Laplacian of the graph, and what else is there.

    L   n x n, or n x n x modes: row i has -w_ij where agent i listens to j, and its sum is 0.  Required.
    A, C, W, P   exosystem and observer;   k   gains: one number, n of them, or m x m x n
    xbar   target;   offsets   n x m;   h   the coupling as text (default y);   labels, modes   cell arrays of text
    name   of the problem

Numbers are doubles and mean their shortest decimal text.  ``export.matrices`` writes the same names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.importing.mat_file import read_variables
from dobc_design.problem.exosystem import Exosystem
from dobc_design.problem.network import Network
from dobc_design.problem.observer import Observer
from dobc_design.problem.problem import Problem

KNOWN = ("A", "C", "L", "W", "P", "k", "xbar", "offsets", "h", "labels", "modes", "name")
SUM_TOLERANCE = 1e-9  # of a row of L, relative to its largest entry
LINEAR = 'The file has no coupling h: it is taken to be linear, h = "y", as a Laplacian alone says.'


def read_mat(data: bytes, *, file: str, name: str) -> Problem:
    """Make the problem of a .mat file; ``file``: its name, for messages; ``name``: the problem's, if it has none.

    Raises: SpecError that names the variable.
    """
    found = {key: value for key, value in read_variables(data, name=file).items() if key in KNOWN}
    L = found.get("L")
    if L is None:
        raise SpecError(
            f"{file} must hold the variable L, the Laplacian of the graph (row i: -w_ij where i listens to j);"
            f" it has {', '.join(found) or 'none of the known ones'}.",
            key="L",
            cure=f"Known variables are {', '.join(KNOWN)}.",
        )
    layers = _layers(L)
    n = layers[0].shape[0]
    labels = _texts(found.get("labels"), "labels", count=n)
    modes = _texts(found.get("modes"), "modes", count=len(layers))
    names = modes or (["G"] if len(layers) == 1 else [f"G{i + 1}" for i in range(len(layers))])
    network = Network.from_sparse(
        {mode: _weights(layer, mode) for mode, layer in zip(names, layers, strict=True)},
        arrow="listens_to",
        labels=labels,
    )
    exosystem = _exosystem(found)
    W, P = (_rows(found[name], name) if name in found else None for name in ("W", "P"))
    observer = None if W is None and P is None else Observer(W=W, P=P)
    h = found.get("h")
    return Problem(
        name=_name(found.get("name"), name),
        network=network,
        coupling="y" if h is None else _coupling(h),
        target=_target(found),
        gains=_gains(found.get("k"), network.labels),
        exosystem=exosystem,
        observer=observer,
        offsets=_offsets(found.get("offsets"), network.labels),
        notes=[LINEAR] if h is None else [],
    )


def _matrix(value: Any, key: str) -> Any:
    if not isinstance(value, np.ndarray) or np.iscomplexobj(value):
        raise SpecError(
            f"{key} must be a real matrix; got {_kind(value)}.", key=key, cure="Save a matrix of real numbers."
        )
    return value


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return "complex numbers"
    return "text" if value and isinstance(value[0], str) else "a cell array"


def _rows(value: Any, key: str = "matrix") -> list[list[Any]]:
    rows: list[list[Any]] = _matrix(value, key).tolist()
    return rows


def _layers(L: Any) -> list[Any]:
    array = _matrix(L, "L")
    if array.ndim > 3 or array.shape[0] != array.shape[1] or 0 in array.shape:
        raise SpecError(
            f"L must be n x n, or n x n x modes; got shape {array.shape}.",
            key="L",
            cure="One row and column per agent.",
        )
    return [array] if array.ndim == 2 else [array[:, :, k] for k in range(array.shape[2])]


def _weights(L: Any, mode: str) -> Any:
    """The weights -L_ij off the diagonal, after a look at signs and sums."""
    off = L - np.diag(np.diag(L))
    if not np.isfinite(L).all() or (off > 0).any():
        raise SpecError(
            f'L (mode "{mode}") must be finite, with entries <= 0 off the diagonal: they are -w_ij.',
            key="L",
            cure="Laplacian = degree matrix - adjacency matrix.",
        )
    room = SUM_TOLERANCE * max(1.0, float(np.abs(L).max()))
    if np.abs(L.sum(axis=1)).max() > room:
        turned = np.abs(L.sum(axis=0)).max() <= room
        raise SpecError(
            f'L (mode "{mode}") must have rows that sum to 0: row i belongs to the listener i.',
            key="L",
            cure="Its columns do: give the transpose." if turned else "Laplacian = degree matrix - adjacency matrix.",
        )
    return sp.coo_array(-off)


def _exosystem(found: Mapping[str, Any]) -> Exosystem | None:
    if ("A" in found) != ("C" in found):
        raise SpecError("A and C must stand together: xi' = A xi, d = C xi.", key="A", cure="Give both or neither.")
    return Exosystem(A=_rows(found["A"], "A"), C=_rows(found["C"], "C")) if "A" in found else None


def _gains(k: Any, labels: Sequence[str]) -> Any:
    """One number for all, n numbers, or one m x m matrix per agent."""
    if k is None:
        return None
    array = _matrix(k, "k")
    if array.ndim == 3 and array.shape[2] == len(labels):
        return {label: array[:, :, i].tolist() for i, label in enumerate(labels) if array[:, :, i].any()}
    flat = array.ravel().tolist()
    if array.ndim == 2 and len(flat) == 1:
        return flat[0]
    if array.ndim == 2 and len(flat) == len(labels):
        return {label: gain for label, gain in zip(labels, flat, strict=True) if gain}
    raise SpecError(
        f"k must be one gain, {len(labels)} gains, or m x m x {len(labels)}; got shape {array.shape}.",
        key="k",
        cure="For example k = zeros(n, 1); k(1) = 5.",
    )


def _offsets(offsets: Any, labels: Sequence[str]) -> dict[str, list[Any]] | None:
    if offsets is None:
        return None
    rows = _rows(offsets, "offsets")
    if len(rows) != len(labels):
        raise SpecError(
            f"offsets must have {len(labels)} rows, one per agent; got {len(rows)}.", key="offsets", cure="n x m."
        )
    return dict(zip(labels, rows, strict=True))


def _target(found: Mapping[str, Any]) -> Any:
    if "xbar" not in found:
        return 0
    flat = _matrix(found["xbar"], "xbar").ravel().tolist()
    return flat[0] if len(flat) == 1 else flat


def _texts(value: Any, key: str, *, count: int) -> list[str] | None:
    """A cell array of text, or the rows of a character matrix."""
    if value is None:
        return None
    texts = _all_texts(value, key)
    if len(texts) != count:
        raise SpecError(f"{key} must hold {count} texts; got {len(texts)}.", key=key, cure="A cell array of text.")
    return texts


def _all_texts(value: Any, key: str) -> list[str]:
    """One text a row of characters, or a cell."""
    cells = value if isinstance(value, list) else [value]
    rows = [each[0] if isinstance(each, list) and len(each) == 1 else each for each in cells]
    for each in rows:
        if not isinstance(each, str):
            raise SpecError(f"{key} must be text; got {shown(each)}.", key=key, cure="In quotes.")
    return [each.rstrip() for each in rows]


def _coupling(h: Any) -> str | list[str]:
    texts = _all_texts(h, "h")
    return texts[0] if len(texts) == 1 else texts


def _name(value: Any, default: str) -> str:
    texts = [""] if value is None else _all_texts(value, "name")
    return texts[0] if len(texts) == 1 and texts[0] else default
