"""Sines whose frequency is known to lie in a band only: [exosystem] bands and amplitude.

No exosystem generates such a sine exactly, so it is bounded like other parts of the disturbance
that the model leaves out (``uncertainty``); poles of the observer's model inside the band make
little of it (theory, section 19).
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from dobc_design.errors import Mistakes, wrong
from dobc_design.exact.number import nearest, parse_number
from dobc_design.exact.reading import is_list, shown, shown_number, whole_number

KEYS = ("bands", "bands_hz")
MOST_PAIRS = 10
#: Frequencies far beyond any have no floats.
LEAST, MOST = Fraction(1, 10**100), Fraction(10**100)
#: 2 pi lies between these; a band in Hz becomes a little wider.
TAU = (Fraction(6283185307179, 10**12), Fraction(6283185307180, 10**12))
_DIGITS = 8  # of the frequency of a pole


class Band(NamedTuple):
    """A sine of one constant frequency in [low, high] (rad/s), and of any phase, in every component
    of every disturbance, at most as large as ``amplitude``."""

    low: Fraction
    high: Fraction
    amplitude: Fraction


def read_bands(value: Any, key: str = "uncertainty.bands") -> tuple[Band, ...] | None:
    """Rows (low, high, amplitude) in rad/s and the unit of d; None without any.  Raises: SpecError
    that names the row."""
    if value is None:
        return None
    if not is_list(value):
        raise wrong(key, f"must be a list of bands; got {shown(value)}.", _EXAMPLE)
    return tuple(_band(row, f"{key}[{k}]") for k, row in enumerate(value)) or None


_EXAMPLE = "For example bands = [[1.8, 2.2]] (rad/s) and amplitude = 0.5."


def _band(row: Any, key: str) -> Band:
    """One band.  Raises: SpecError."""
    if not is_list(row) or len(row) != len(Band._fields):
        raise wrong(key, f"must be [low, high, amplitude]; got {shown(row)}.", _EXAMPLE)
    low, high, amplitude = (parse_number(x, key) for x in row)
    if not 0 <= low <= high or not LEAST < high < MOST:
        raise wrong(
            key,
            "must be [low, high] with 0 <= low <= high, and 1e-100 < high < 1e100 rad/s; got "
            f"[{shown_number(low)}, {shown_number(high)}].",
            _EXAMPLE,
        )
    if amplitude <= 0:
        raise wrong(
            "exosystem.amplitude" if key.startswith("exosystem") else key,
            f"must be > 0, because it bounds the sine; got {shown_number(amplitude)}.",
            "It is in the unit of d.",
        )
    return Band(low, high, amplitude)


def bands_of(table: Any) -> tuple[Band, ...]:
    """The bands of [exosystem]: in rad/s and in Hz, with one amplitude for all or one for each.
    Raises: SpecError that names every wrong key."""
    rows: list[tuple[str, Any]] = []
    errors = Mistakes()
    for key in KEYS:
        given = getattr(table, key)
        if given is None:
            continue
        name = f"exosystem.{key}"
        if not is_list(given) or not given or not all(is_list(x) and len(x) == 2 for x in given):
            what = f"must be a list of pairs [low, high]; got {shown(given)}."
            errors.append(wrong(name, what, _EXAMPLE))
            continue
        for k, pair in enumerate(given):
            rows.append((f"{name}[{k}]", pair))
    beside = [name for name in ("amplitude", "pairs") if getattr(table, name) is not None]
    if not rows and not errors and beside:
        key = f"exosystem.{beside[0]}"
        errors.append(wrong(key, "belongs to bands, and there are none.", _EXAMPLE))
    errors.raise_all()
    if not rows:
        return ()
    found = []
    # What is wrong with the bands themselves is said at once.
    sizes: Sequence[Any] = [1] * len(rows)
    with errors:
        sizes = _amplitudes(table.amplitude, len(rows))
    for (key, pair), size in zip(rows, sizes, strict=True):
        with errors:
            ends = [parse_number(x, key) for x in pair]
            if key.startswith("exosystem.bands_hz"):
                ends = [x * tau for x, tau in zip(ends, TAU, strict=True)]
            found.append(_band([*ends, size], key))
    errors.raise_all()
    return tuple(found)


def _amplitudes(value: Any, count: int) -> Sequence[Any]:
    """One for each band.  Raises: SpecError."""
    key = "exosystem.amplitude"
    if value is None:
        raise wrong(key, "is required with bands and missing.", _EXAMPLE)
    if not is_list(value):
        return [parse_number(value, key)] * count
    if len(value) != count:
        what = f"must be one number, or one for each of {count} bands; got {len(value)}."
        raise wrong(key, what, _EXAMPLE)
    return [parse_number(x, f"{key}[{k}]") for k, x in enumerate(value)]


def pairs_of(table: Any) -> int:
    """How many pairs of poles a band is given.  Raises: SpecError."""
    if table.pairs is None:
        return 1
    cure = "It is how many pairs of poles each band is given."
    return whole_number(table.pairs, "exosystem.pairs", least=1, most=MOST_PAIRS, cure=cure)


def nodes(low: Fraction, high: Fraction, pairs: int) -> list[Fraction]:
    """Frequencies (rad/s) for so many pairs of poles: the Chebyshev nodes of w^2 in the band, at
    which the largest of |chi_A| on it is least.  Rounded: they are a choice."""
    least = nearest(low / high) ** 2
    found = []
    for k in range(pairs):
        part = (1 + math.cos(math.pi * (2 * k + 1) / (2 * pairs))) / 2
        w = nearest(high) * math.sqrt(least + (1 - least) * part)
        found.append(Fraction(f"{w:.{_DIGITS}g}"))
    return sorted(set(found))


def band_words(band: Band) -> str:
    """A band in words, with its numbers."""
    low, high, amplitude = map(nearest, band)
    hz = f"{low / math.tau:.4g} to {high / math.tau:.4g} Hz"
    return f"a sine of {low:.6g} to {high:.6g} rad/s ({hz}) of amplitude up to {amplitude:.6g}"
