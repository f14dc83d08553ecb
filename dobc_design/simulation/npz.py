"""Files of arrays (.npz): written at once, and read with suspicion, nothing of them unpickled."""

import io
import math
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SpecError, refused
from dobc_design.exact.reading import Table, shown
from dobc_design.problem.load import read_bytes

ABOUT = "about"  # the name of the array that holds text
LARGEST = 1 << 28  # bytes of the arrays of a file once unpacked, if the file itself is smaller
LARGEST_FILE = 1 << 31

Shapes = Mapping[str, tuple[int, ...]]


class UnfitError(ValueError):
    """What a file of arrays says cannot be; the text says what."""


def require(holds: object, what: str) -> None:
    """Raises: UnfitError, of a file for which this does not hold."""
    if not holds:
        raise UnfitError(what)


@contextmanager
def describing(path: Path, *, key: str, what: str, cure: str) -> Iterator[None]:
    """Reading ``path``, which ought to be a ``what``: whatever goes wrong is a SpecError that names
    ``key``."""
    try:
        yield
    except SpecError as error:  # there is no such file, or it is none
        raise refused(key, f"{key}: {error.message}", error.cure) from None
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - zipfile, zlib, NumPy, csv and json have many words for broken bytes
        reason = str(error) if isinstance(error, UnfitError) else "its bytes are damaged"
        message = f"{key}: {shown(path.name)} does not hold a {what} ({reason})."
        raise refused(key, message, cure) from None


def read_arrays(
    path: Path, names: Sequence[str], fits: Callable[[Shapes], None]
) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file, those of ``names`` that are there; nothing is unpickled.  Sizes
    and shapes are read before the data: ``fits`` sees them, and may raise.  Unpacked, the arrays
    may take LARGEST bytes, or as many as the file has.  Raises: what ``describing`` expects."""
    data = read_bytes(path, limit=LARGEST_FILE, what="file of arrays")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        listed = {each.filename.removesuffix(".npy"): each for each in archive.infolist()}
        chosen = {name: listed[name] for name in names if name in listed}
        total = sum(each.file_size for each in chosen.values())
        most = max(LARGEST, len(data))
        require(total <= most, f"unpacked it would take {total} bytes; at most {LARGEST} are read")
        fits({name: _shape_of(archive, member, name) for name, member in chosen.items()})
        found = {}
        for name, member in chosen.items():
            with archive.open(member) as stream:
                found[name] = np.lib.format.read_array(stream, allow_pickle=False)
    return found


def _shape_of(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> tuple[int, ...]:
    """What the head of an array says, where its kind and size agree with it."""
    heads = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    kinds = "U" if name == ABOUT else "fiu"
    what = "text" if name == ABOUT else "numbers"
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        shape, _, dtype = heads[version](stream)
        require(dtype.kind in kinds, f"{name} must be {what}")
        size = stream.tell() + math.prod(shape) * dtype.itemsize
        require(size == member.file_size, f"{name} does not have the size that its head says")
    return tuple(shape)


def arrays_bytes(arrays: Table) -> bytes:
    """Arrays as an .npz file."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def save_arrays(path: Path, data: bytes, *, force: bool) -> Path:
    """Write an .npz file.  Raises: SpecError if the place is taken, unless ``force``,
    CertificateError if it fails."""
    if path.exists() and not force:
        message = f"{shown(str(path))} exists already."
        raise refused("path", message, "Replace it with force=True.")
    write_atomically(path, data)
    return path
