"""Common shapes of disturbances as exosystems (12): constant, ramp, harmonics, their sums, a
truncated periodic signal.

Every one has a single output, d = C xi, m = 1, and is observable; ``stacked`` gives one to each of
several components.  Numbers in are exact, numbers out are exact.  A frequency is in rad/s: 50 Hz is
"314.159265358979", not 50.
"""

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design._checks import noun, put, require_square
from dobc_design._show.cards import Shown
from dobc_design.errors import misshapen, refused, wrong
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import nearest, parse_number, typed_number
from dobc_design.exact.reading import (
    counted,
    flag,
    is_list,
    one_of,
    positive_number,
    read_matrix,
    shown,
    shown_number,
    whole_number,
)

__all__ = [
    "KINDS",
    "constant",
    "harmonics",
    "of_parts",
    "periodic",
    "polynomial",
    "ramp",
    "stacked",
    "total",
]


@noun
class Exosystem(Shown):
    """Generator of one agent's disturbance: xi' = A xi, d = C xi (eq. 12).

    Shapes: A (q, q) in 1/s, C (m, q).  Accepts nested sequences or arrays of exact numbers, or a
    python-control StateSpace in place of both.
    Raises: ShapeError or SpecError naming exosystem.A or exosystem.C.
    Example:
        >>> dd.Exosystem([[0, 2], [-2, 0]], [[1, 0]]).order
        2
    """

    A: Matrix
    C: Matrix

    def __init__(self, A: Any, C: Sequence[Sequence[Any]] | None = None) -> None:
        if C is None:
            A, C = _matrices_of(A)
        dynamics, output = read_matrix(A, "exosystem.A"), read_matrix(C, "exosystem.C")
        q = len(dynamics)
        width = len(dynamics[0])
        if q != width == len(output) == len(output[0]):
            what = f"must be square; got shape ({q}, {width}), and C is {width}x{width}."
            cure = "A and C look exchanged: exchange them."
            raise misshapen("exosystem.A", what, cure)
        require_square(dynamics, "exosystem.A")
        if len(output[0]) != q:
            raise misshapen(
                "exosystem.C",
                f"must have {counted(q, 'column')}, one per exosystem state (A is {q}x{q}); got "
                f"shape ({len(output)}, {len(output[0])}).",
                "Each row of C picks one component of the disturbance.",
            )
        put(self, A=dynamics, C=output)

    @property
    def order(self) -> int:
        """q, the number of exosystem states."""
        return len(self.A)

    @property
    def outputs(self) -> int:
        """m, the number of disturbance components."""
        return len(self.C)


def _matrices_of(system: Any) -> tuple[Any, Any]:
    """A and C of a control.StateSpace; floats are read as their shortest decimal text.  Raises:
    SpecError for a system in discrete time or without A and C."""
    if not hasattr(system, "A") or not hasattr(system, "C"):
        what = f"must be A and C, or a state-space system with both; got {type(system).__name__}."
        raise wrong("exosystem", what, "For a transfer function: control.ss(system).")
    if getattr(system, "dt", None):
        what = "must be in continuous time, xi' = A xi; got one with the time step"
        what += f" {shown(system.dt)}."
        raise wrong("exosystem", what, "Give the continuous-time system.")
    return np.asarray(system.A).tolist(), np.asarray(system.C).tolist()


LARGEST_DEGREE = 20
KINDS = ("constant", "ramp", "harmonics")  # that a problem file may name by ``kind``
PARTS = ("kind", "constant", "ramp", "hz", "frequencies")  # its keys in place of A and C
DIGITS = 12  # of 2 pi f for a frequency in Hz


def of_parts(
    *,
    kind: Any = None,
    constant: Any = None,
    ramp: Any = None,
    hz: Any = None,
    frequencies: Any = None,
    components: int = 1,
) -> Exosystem:
    """The exosystem that a problem file describes in words, one for each of ``components``
    (``stacked``): ``constant`` and ``ramp`` are true or false, ``hz`` (cycles per second; 2 pi f is
    rounded to 12 digits) and ``frequencies`` (rad/s) numbers or lists; ``kind`` names a single
    part.  Raises: SpecError naming the key."""
    if kind is not None:
        one_of(kind, KINDS, "exosystem.kind", "For another shape give A and C.")
        beside = {"constant": constant, "ramp": ramp, "hz": hz}
        if kind != "harmonics":
            beside["frequencies"] = frequencies
        elif frequencies is None:
            raise wrong(
                "exosystem.frequencies",
                "is required for harmonics and missing.",
                "Write frequencies = [2], in rad/s; or, without kind, hz = [0.5].",
            )
        for key, value in beside.items():
            if value is not None:
                raise wrong(
                    f"exosystem.{key}",
                    "cannot stand beside kind.",
                    "Remove kind: parts without it add up.",
                )
        constant = kind == "constant"
        ramp = kind == "ramp"
    for key, value in (("constant", constant), ("ramp", ramp)):
        if value is not None:
            flag(value, f"exosystem.{key}", f"Write {key} = true.")
    # A ramp starts somewhere: it has the constant in it.
    shapes = [polynomial(1 if ramp else 0)] if constant or ramp else []
    # Sines of both keys are compared with each other: 0.5 Hz and 3.14 rad/s may be one.
    sines: dict[Fraction, str] = {}
    for key, value in (("frequencies", frequencies), ("hz", hz)):
        if value is not None:
            _add_sines(sines, value, key=f"exosystem.{key}")
    if sines:
        shapes.append(_sum_of_sines(sines))
    if not shapes:
        raise wrong(
            "exosystem",
            "is empty: no part is true and no frequency is given.",
            "Write constant = true, ramp = true, hz = [0.5] or frequencies = [2]; they add up.",
        )
    return stacked(*[total(*shapes)] * components)


def _add_sines(found: dict[Fraction, str], value: Any, *, key: str) -> None:
    """Add angular frequencies (rad/s) to ``found``, each with the key that states it; those of the
    key hz are in Hz, and 2 pi f is rounded to twelve digits."""
    in_hz = key.endswith("hz")
    given = list(value) if is_list(value) else [value]
    if not given:
        raise wrong(
            key,
            f"must hold at least one number ({'Hz' if in_hz else 'rad/s'}); got none.",
            "Without sines leave it out, for example constant().",
        )
    for k, each in enumerate(given):
        name = f"{key}[{k}]" if is_list(value) else key
        w = parse_number(each, name)
        if w <= 0 or (in_hz and not Fraction(1, 10**15) < w < 10**15):
            limits = "between 1e-15 and 1e15 Hz" if in_hz else "> 0 (rad/s)"
            cure = "A constant part is added by constant = true, in Python by total(constant(), "
            cure += "harmonics(...))."
            if w < 0:
                # As it stands in a file, where 1/5 is no number.
                cure = f"Write {typed_number(-w)}: the sign is part of the phase, which is free."
            raise wrong(name, f"must be {limits}; got {shown_number(w)}.", cure)
        # 2 pi f is irrational: the claim is about the rounded frequency, which is written down.
        if in_hz:
            w = Fraction(f"{math.tau * w.numerator / w.denominator:.{DIGITS}g}")
        if w in found:
            size = nearest(w)
            raise wrong(
                name,
                f"must differ from {found[w]}, because equal sines cannot be told apart; both are "
                f"{size:.6g} rad/s ({size / math.tau:.6g} Hz).",
                "Name each frequency once; amplitude and phase are free.",
            )
        found[w] = name


def _sum_of_sines(frequencies: Iterable[Fraction]) -> Exosystem:
    return total(*(Exosystem(A=[[0, w], [-w, 0]], C=[[1, 0]]) for w in frequencies))


def constant() -> Exosystem:
    """An unknown constant: A = [0], C = [1]."""
    return polynomial(0)


def ramp() -> Exosystem:
    """An unknown constant with an unknown slope: A = [[0, 1], [0, 0]], C = [1, 0]."""
    return polynomial(1)


def polynomial(degree: Any) -> Exosystem:
    """An unknown polynomial in time; the state holds the disturbance and its derivatives.  Raises:
    SpecError unless ``degree`` is an integer from 0 to 20."""
    cure = "0 is a constant, 1 a ramp."
    order = 1 + whole_number(degree, "degree", least=0, most=LARGEST_DEGREE, cure=cure)
    A = [[int(j == i + 1) for j in range(order)] for i in range(order)]
    return Exosystem(A=A, C=[[1] + [0] * degree])


def harmonics(frequencies: Any) -> Exosystem:
    """A sum of sines of unknown amplitude and phase at given angular frequencies (rad/s), a number
    or a list.

    One block [[0, w], [-w, 0]] for each; d is the sum of the first states of the blocks.
    Raises: SpecError unless the frequencies are positive and all different (two equal ones could
    not be told apart).
    Example:
        >>> dd.exosystems.harmonics([1, "5/2"]).order
        4
    """
    found: dict[Fraction, str] = {}
    _add_sines(found, frequencies, key="frequencies")
    return _sum_of_sines(found)


def periodic(fundamental: Any, *, harmonics_kept: Any, mean: bool = True) -> Exosystem:
    """A periodic disturbance by truncation: the mean and the first sines of its Fourier series.
    ``fundamental`` is the angular frequency (rad/s); ``mean`` keeps the constant term. What is cut
    off is an unmodelled disturbance for the observer. Raises: SpecError unless fundamental > 0 and
    harmonics_kept is an integer >= 1."""
    w = positive_number(fundamental, "fundamental", "rad/s")
    kept = harmonics_kept
    if type(kept) is not int or kept < 1:
        raise wrong(
            "harmonics_kept",
            f"must be an integer >= 1; got {shown(kept)}.",
            "For a constant disturbance use constant().",
        )
    sines = harmonics([w * k for k in range(1, kept + 1)])
    return total(constant(), sines) if mean else sines


def total(*parts: Exosystem) -> Exosystem:
    """The sum of disturbances: A block diagonal, the C side by side.

    The sum is observable only if the parts share no eigenvalue that one output cannot tell apart.
    Raises: SpecError without parts or if they have different numbers of components.
    Example:
        >>> dd.exosystems.total(dd.exosystems.constant(), dd.exosystems.harmonics(2)).order
        3
    """
    outputs = _require_parts(parts)
    if len({part.outputs for part in parts}) > 1:
        sizes = ", ".join(str(part.outputs) for part in parts)
        what = "the parts of a total must have equally many components, because they are added;"
        raise refused(
            "parts", f"{what} got {sizes}.", "stacked(...) gives every part components of its own."
        )
    C = [[x for part in parts for x in part.C[row]] for row in range(outputs)]
    return Exosystem(A=block_diagonal([part.A for part in parts]), C=C)


def stacked(*parts: Exosystem) -> Exosystem:
    """Each part drives components of its own: A and C block diagonal.  For m > 1.  Raises:
    SpecError without parts."""
    _require_parts(parts)
    A = block_diagonal([part.A for part in parts])
    return Exosystem(A=A, C=block_diagonal([part.C for part in parts]))


def _require_parts(parts: Sequence[Exosystem]) -> int:
    if not parts or not all(isinstance(part, Exosystem) for part in parts):
        raise wrong(
            "parts",
            "must be at least one Exosystem.",
            "For example total(constant(), harmonics([1, 2])).",
        )
    return parts[0].outputs


def block_diagonal(blocks: Sequence[Matrix]) -> Matrix:
    """Matrices along the diagonal, zeros elsewhere."""
    zero = Fraction(0)
    # Row by row, with zeros on both sides of each block.
    width = sum(len(block[0]) for block in blocks)
    before = 0  # columns of the blocks that are placed
    rows = []
    for block in blocks:
        after = width - before - len(block[0])
        rows += [(zero,) * before + tuple(row) + (zero,) * after for row in block]
        before += len(block[0])
    return tuple(rows)
