"""MATLAB files (.mat, up to version 7): A, C of the exosystem, L, the Laplacian of the graph, and what else is there.

    L   n x n, or n x n x modes: row i has -w_ij where agent i listens to j, and its sum is 0.  Required.
    A, C, W, P   exosystem and observer;   k   gains: one number, n of them, or m x m x n
    xbar   target;   offsets   n x m;   h   the coupling as text (default y);   labels, modes   cell arrays of text
    name   of the problem

Numbers are doubles and mean their shortest decimal text.  ``export.matrices`` writes the same names.
SciPy's loadmat is not asked: on damaged files it ends the process by a segmentation fault.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import scipy.sparse as sp

from dobc_design.errors import SpecError, wrong
from dobc_design.exact.reading import shown
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

LARGEST = 512 * 1024 * 1024  # bytes of all variables once unpacked
MOST_NUMBERS = 50_000_000  # of one array
MOST_PARTS = 1_000_000  # of one text or cell array, and numbers of an array in a cell
DEEPEST = 4  # cells in cells
HEADER = 128
CELL, CHARACTERS, SPARSE, FIRST_NUMBER, LAST_NUMBER = 1, 4, 5, 6, 15  # classes of arrays
MATRIX, COMPRESSED = 14, 15  # types of elements
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {16: "utf-8", 17: "utf-16", 18: "utf-32"}

Value = Any  # a float array; a list of texts, the rows of a character array; or a list of values, a cell array


class _Broken(Exception):
    """The bytes are not what the format says; the text says where."""


@dataclass(frozen=True, slots=True)
class _Element:
    kind: int
    data: bytes


def read_variables(data: bytes, *, name: str, names: Collection[str]) -> dict[str, Value]:
    """The variables of a file that are among ``names``; ``name`` of the file is for messages.  Numbers become float64
    arrays (complex ones stay complex), characters a list with one text a row, cells a list. Raises: SpecError for a
    file that is damaged, or of another version."""
    cure = "Save it by save(file, '-v7')."
    if len(data) < HEADER or data[126:128] not in (b"IM", b"MI"):
        raise wrong(name, "is no MATLAB file of version 5 to 7.", cure)
    order = "<" if data[126:128] == b"IM" else ">"
    if struct.unpack(f"{order}H", data[124:126])[0] != 0x0100:
        raise wrong(name, "is a MATLAB file of version 7.3, which is not read.", cure)
    try:
        found, total = dict[str, Value](), 0
        for each in _elements(data[HEADER:], order):
            key, value = _array(each.data, order, 0) if each.kind == MATRIX else ("", None)
            total += len(each.data) + getattr(value, "nbytes", 0)
            if total > LARGEST:
                raise _Broken(f"its variables take more than {LARGEST} bytes")
            if value is not None and key in names:
                found[key] = value
    except (_Broken, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise wrong(name, f"is a damaged MATLAB file: {str(error)[:80]}.", cure) from None
    return found


def _elements(data: bytes, order: str, *, inside: bool = False) -> Iterator[_Element]:
    """The elements one after another; compressed ones are unpacked, which may not lie ``inside`` another one."""
    place = 0
    while place + 8 <= len(data):
        first, size = struct.unpack_from(f"{order}II", data, place)
        if first >> 16:  # up to four bytes stand beside their tag
            kind, size, begin, after = first & 0xFFFF, first >> 16, place + 4, place + 8
            if size > 4:
                raise _Broken(f"a small element of {size} bytes")
        else:
            kind, begin = first, place + 8
            after = begin + size + (0 if kind == COMPRESSED else -size % 8)
        if begin + size > len(data):
            raise _Broken("an element is cut off")
        if kind == COMPRESSED and inside:
            raise _Broken("a variable is compressed twice")
        if kind == COMPRESSED:
            yield from _elements(_unpacked(data[begin : begin + size]), order, inside=True)
        else:
            yield _Element(kind, data[begin : begin + size])
        place = after


def _unpacked(data: bytes) -> bytes:
    try:
        machine = zlib.decompressobj()
        unpacked = machine.decompress(data, LARGEST)
    except zlib.error as error:
        raise _Broken("a compressed variable cannot be unpacked") from error
    if machine.unconsumed_tail:
        raise _Broken("a variable is too large")
    return unpacked


def _array(data: bytes, order: str, depth: int) -> tuple[str, Value]:
    """Name and value of an array; the value is None for a class that is not read."""
    parts = list(islice(_elements(data, order, inside=True), 3 + MOST_PARTS))
    if len(parts) < 3 or len(parts[0].data) < 8:
        raise _Broken("a variable without a head")
    flags = struct.unpack_from(f"{order}I", parts[0].data)[0]
    shape = [int(size) for size in _numbers(parts[1], order)]
    name = parts[2].data.decode("ascii", errors="replace")
    kind, is_complex = flags & 0xFF, bool(flags & 0x0800)
    most = MOST_PARTS if depth or kind in (CELL, CHARACTERS) else MOST_NUMBERS
    if len(shape) < 2 or any(size < 0 for size in shape) or math.prod(shape) > most:
        raise _Broken(f"a variable of the shape {shape[:4]}")
    body = parts[3:]
    if kind == CELL:
        if depth >= DEEPEST or len(body) != math.prod(shape):
            raise _Broken("a cell array of inconsistent size")
        return name, [_array(each.data, order, depth + 1)[1] for each in body]
    if kind == CHARACTERS:
        return name, _rows_of_text(body, shape, order)
    if kind == SPARSE:
        return name, _sparse(body, shape, order)
    if FIRST_NUMBER <= kind <= LAST_NUMBER:
        values = _shaped(body[:1], shape, order)
        return name, values + 1j * _shaped(body[1:2], shape, order) if is_complex else values
    return name, None


def _numbers(element: _Element, order: str) -> Any:
    if element.kind not in NUMBERS:
        raise _Broken(f"numbers of the unknown type {element.kind}")
    dtype = np.dtype(f"{order}{NUMBERS[element.kind]}")
    if len(element.data) % dtype.itemsize:
        raise _Broken("numbers that are cut off")
    return np.frombuffer(element.data, dtype=dtype)


def _shaped(body: list[_Element], shape: list[int], order: str) -> Any:
    values = _numbers(body[0], order).astype(np.float64) if body else np.zeros(0)
    if len(values) != math.prod(shape):
        raise _Broken(f"{len(values)} numbers for the shape {shape[:4]}")
    return values.reshape(shape, order="F")


def _rows_of_text(body: list[_Element], shape: list[int], order: str) -> list[str]:
    if not body or math.prod(shape) == 0:
        return [""]
    if body[0].kind in TEXTS:
        ending = "" if body[0].kind == 16 else "-le" if order == "<" else "-be"
        text = body[0].data.decode(TEXTS[body[0].kind] + ending)
    else:
        text = "".join(chr(int(code)) for code in _numbers(body[0], order))
    if len(text) != math.prod(shape):
        raise _Broken(f"{len(text)} characters for the shape {shape[:4]}")
    rows = shape[0]
    return [text[row::rows] for row in range(rows)]


def _sparse(body: list[_Element], shape: list[int], order: str) -> Any:
    """A sparse matrix, dense: compressed columns with row numbers, column starts and values."""
    if len(body) < 3 or len(shape) != 2:
        raise _Broken("a sparse matrix of inconsistent size")
    rows, starts, values = (_numbers(each, order) for each in body[:3])
    count = int(starts[-1]) if len(starts) else 0
    rows = rows[:count].astype(np.int64)
    starts = starts.astype(np.int64)
    fits = len(starts) == shape[1] + 1 and starts[0] == 0 and bool(np.all(np.diff(starts) >= 0))
    if not fits or min(len(rows), len(values)) < count or np.any((rows < 0) | (rows >= shape[0])):
        raise _Broken("a sparse matrix of inconsistent size")
    dense = np.zeros(shape)
    np.add.at(dense, (rows, np.repeat(np.arange(shape[1]), np.diff(starts))), values[:count].astype(np.float64))
    return dense


KNOWN = ("A", "C", "L", "W", "P", "k", "xbar", "offsets", "h", "labels", "modes", "name")
SUM_TOLERANCE = 1e-9  # of a row of L, relative to its largest entry
LINEAR = 'The file has no coupling h: it is taken to be linear, h = "y", as a Laplacian alone says.'


def read_mat(data: bytes, *, file: str, name: str) -> Problem:
    """The problem of a .mat file; ``name``: the problem's if it has none.  Raises: SpecError naming the variable."""
    found = read_variables(data, name=file, names=KNOWN)
    L = found.get("L")
    if L is None:
        what = f"{file} must hold the variable L, the Laplacian of the graph (row i: -w_ij where i listens to j);"
        what += f" it has {', '.join(found) or 'none of the known ones'}."
        raise SpecError(what, key="L", cure=f"Known variables are {', '.join(KNOWN)}.")
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
    if ("A" in found) != ("C" in found):
        raise wrong("A", "and C must stand together: xi' = A xi, d = C xi.", "Give both or neither.")
    A, C, W, P = (_matrix(found[name], name).tolist() if name in found else None for name in ("A", "C", "W", "P"))
    xbar = _matrix(found.get("xbar", np.zeros(1)), "xbar").ravel().tolist()
    offsets = _matrix(found["offsets"], "offsets").tolist() if "offsets" in found else None
    if offsets is not None and len(offsets) != n:
        raise wrong("offsets", f"must have {n} rows, one per agent; got {len(offsets)}.", "n x m.")
    h, title = _all_texts(found.get("h", "y"), "h"), _all_texts(found.get("name", ""), "name")
    return Problem(
        name=title[0] if len(title) == 1 and title[0] else name,
        network=network,
        coupling=h[0] if len(h) == 1 else h,
        target=xbar[0] if len(xbar) == 1 else xbar,
        gains=_gains(found.get("k"), network.labels),
        exosystem=None if A is None or C is None else Exosystem(A=A, C=C),
        observer=None if W is None and P is None else Observer(W=W, P=P),
        offsets=None if offsets is None else dict(zip(network.labels, offsets, strict=True)),
        notes=[] if "h" in found else [LINEAR],
    )


def _matrix(value: Any, key: str) -> Any:
    if isinstance(value, np.ndarray) and not np.iscomplexobj(value):
        return value
    kind = "text" if len(value) and isinstance(value[0], str) else "a cell array"
    kind = "complex numbers" if isinstance(value, np.ndarray) else kind
    raise wrong(key, f"must be a real matrix; got {kind}.", "Save a matrix of real numbers.")


def _layers(L: Any) -> list[Any]:
    array = _matrix(L, "L")
    if array.ndim > 3 or array.shape[0] != array.shape[1] or 0 in array.shape:
        raise wrong("L", f"must be n x n, or n x n x modes; got shape {array.shape}.", "One row and column per agent.")
    return [array] if array.ndim == 2 else [array[:, :, k] for k in range(array.shape[2])]


def _weights(L: Any, mode: str) -> Any:
    """The weights -L_ij off the diagonal, after a look at signs and sums."""
    off = L - np.diag(np.diag(L))
    if not np.isfinite(L).all() or (off > 0).any():
        what = f'L (mode "{mode}") must be finite, with entries <= 0 off the diagonal: they are -w_ij.'
        raise SpecError(what, key="L", cure="Laplacian = degree matrix - adjacency matrix.")
    room = SUM_TOLERANCE * max(1.0, float(np.abs(L).max()))
    if np.abs(L.sum(axis=1)).max() > room:
        turned = np.abs(L.sum(axis=0)).max() <= room
        what = f'L (mode "{mode}") must have rows that sum to 0: row i belongs to the listener i.'
        cure = "Its columns do: give the transpose." if turned else "Laplacian = degree matrix - adjacency matrix."
        raise SpecError(what, key="L", cure=cure)
    return sp.coo_array(-off)


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
    what = f"must be one gain, {len(labels)} gains, or m x m x {len(labels)}; got shape {array.shape}."
    raise wrong("k", what, "For example k = zeros(n, 1); k(1) = 5.")


def _texts(value: Any, key: str, *, count: int) -> list[str] | None:
    texts = None if value is None else _all_texts(value, key)
    if texts is not None and len(texts) != count:
        raise wrong(key, f"must hold {count} texts; got {len(texts)}.", "A cell array of text.")
    return texts


def _all_texts(value: Any, key: str) -> list[str]:
    """One text a row of characters, or a cell."""
    cells = value if isinstance(value, list) else [value]
    rows = [each[0] if isinstance(each, list) and len(each) == 1 else each for each in cells]
    for each in rows:
        if not isinstance(each, str):
            raise wrong(key, f"must be text; got {shown(each)}.", "In quotes.")
    return [each.rstrip() for each in rows]
