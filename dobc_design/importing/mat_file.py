"""The bytes of a MATLAB file, versions 5 to 7, as arrays and texts.

Written here because a reader of files from strangers must refuse what is broken: SciPy's loadmat crashes the process on
damaged files.  Numbers, text, cell arrays of these and sparse matrices are read; everything else is passed over.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dobc_design.errors import SpecError

LARGEST = 512 * 1024 * 1024  # bytes of one variable once unpacked
MOST_NUMBERS = 50_000_000  # of one array
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


def read_variables(data: bytes, *, name: str) -> dict[str, Value]:
    """The variables of a file by name; ``name`` of the file is for messages.

    Numbers become float64 arrays (complex ones stay complex), characters a list with one text a row, cells a list.
    Raises: SpecError for a file that is damaged, or of another version.
    """
    cure = "Save it by save(file, '-v7')."
    if len(data) < HEADER or data[126:128] not in (b"IM", b"MI"):
        raise SpecError(f"{name} is no MATLAB file of version 5 to 7.", key=name, cure=cure)
    order = "<" if data[126:128] == b"IM" else ">"
    if struct.unpack(f"{order}H", data[124:126])[0] != 0x0100:
        raise SpecError(f"{name} is a MATLAB file of version 7.3, which is not read.", key=name, cure=cure)
    try:
        found = dict(_array(each.data, order, 0) for each in _elements(data[HEADER:], order) if each.kind == MATRIX)
    except (_Broken, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise SpecError(f"{name} is a damaged MATLAB file: {str(error)[:80]}.", key=name, cure=cure) from None
    return {key: value for key, value in found.items() if value is not None}


def _elements(data: bytes, order: str) -> Iterator[_Element]:
    """The elements one after another; compressed ones are unpacked."""
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
        inside = data[begin : begin + size]
        if kind == COMPRESSED:
            yield from _elements(_unpacked(inside), order)
        else:
            yield _Element(kind, inside)
        place = after


def _unpacked(data: bytes) -> bytes:
    try:
        machine = zlib.decompressobj()
        unpacked = machine.decompress(data, LARGEST)
    except zlib.error as error:
        raise _Broken("a compressed variable cannot be unpacked") from error
    if machine.unconsumed_tail:
        raise _Broken("a variable is too large")
    if len(unpacked) >= 4 and COMPRESSED in (unpacked[0], unpacked[3]) and not unpacked[1] | unpacked[2]:
        raise _Broken("a variable is compressed twice")
    return unpacked


def _array(data: bytes, order: str, depth: int) -> tuple[str, Value]:
    """Name and value of an array; the value is None for a class that is not read."""
    parts = list(_elements(data, order))
    if len(parts) < 3 or len(parts[0].data) < 8:
        raise _Broken("a variable without a head")
    flags = struct.unpack_from(f"{order}I", parts[0].data)[0]
    shape = [int(size) for size in _numbers(parts[1], order)]
    name = parts[2].data.decode("ascii", errors="replace")
    if len(shape) < 2 or any(size < 0 for size in shape) or math.prod(shape) > MOST_NUMBERS:
        raise _Broken(f"a variable of the shape {shape[:4]}")
    kind, is_complex = flags & 0xFF, bool(flags & 0x0800)
    body = parts[3:]
    if kind == CELL:
        if depth >= DEEPEST or len(body) != math.prod(shape):
            raise _Broken("a cell array that does not hold what it says")
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
        raise _Broken("a sparse matrix that does not hold what it says")
    rows, starts, values = (_numbers(each, order) for each in body[:3])
    count = int(starts[-1]) if len(starts) else 0
    rows = rows[:count].astype(np.int64)
    starts = starts.astype(np.int64)
    fits = len(starts) == shape[1] + 1 and starts[0] == 0 and bool(np.all(np.diff(starts) >= 0))
    if not fits or min(len(rows), len(values)) < count or np.any((rows < 0) | (rows >= shape[0])):
        raise _Broken("a sparse matrix that does not hold what it says")
    dense = np.zeros(shape)
    np.add.at(dense, (rows, np.repeat(np.arange(shape[1]), np.diff(starts))), values[:count].astype(np.float64))
    return dense
