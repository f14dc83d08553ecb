"""Writing files so that a reader sees the old one or the new one, never a part."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from dobc_design.errors import CertificateError


def write_atomically(path: Path, data: bytes) -> None:
    """Replace ``path`` by ``data``: temporary file beside it, flushed to disk, renamed.

    Raises: CertificateError when the machine refuses (full disk, read-only folder).
    """
    temporary = None
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise CertificateError(
            f"{path.name} cannot be written: {error.strerror or error}.", key=str(path),
            cure="Choose another folder with --out.",
        ) from error  # fmt: skip
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)


def make_folder(path: Path) -> Path:
    """Make a folder if it is not there.  Raises CertificateError when that cannot be done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CertificateError(
            f"the folder {str(path)!r} cannot be made: {error.strerror or error}.", key=str(path),
            cure="Choose another with --out.",
        ) from error  # fmt: skip
    return path
