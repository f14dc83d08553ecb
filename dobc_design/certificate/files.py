"""Writing files so that a reader sees the old one or the new one, never a part, whatever happens at
any moment.

Every file is written under another name beside its place, flushed to disk and renamed; then the
folder is flushed.  Of several files some may be old and some new, if a kill falls between two
renames; a certificate names the hash of its problem, so that such a pair is found out.  Ctrl-C and
SIGTERM wait until all are renamed.
"""

import errno
import hashlib
import json
import os
import secrets
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

from dobc_design._signals import Postponed
from dobc_design.errors import CertificateError, refused
from dobc_design.exact.reading import shown

STALE = 3600.0  # seconds after which a temporary file belongs to nobody; no write takes so long
# characters of the file's own name in that of its temporary file; systems allow 255 bytes
_LONGEST_NAME = 40
_SUFFIX = ".dobc-tmp"
_CURES = {
    **dict.fromkeys(
        (errno.ENOSPC, errno.EDQUOT), "Free some space there, or choose another folder with --out."
    ),
    errno.EFBIG: "Raise the limit on the size of files, or choose another folder with --out.",
    errno.EISDIR: "Move that folder away, or choose another with --out.",
}


def write_atomically(path: Path, data: bytes) -> None:
    """Replace ``path`` by ``data``.  Raises CertificateError when the machine refuses."""
    write_together({path: data})


#: What `dobc certify` and `dobc report` write beside a certificate.
REPORTS = ("report.html", "report.md", "report.pdf")


def write_together(files: Mapping[Path, bytes], *, without: Iterable[Path] = ()) -> None:
    """Replace several files, in this order, once all of them are on the disk.

    ``without``: files of an earlier run that this one does not have; those that are there are
    removed with it.

    Raises: CertificateError when the machine refuses (full disk, read-only folder); all files are
    then as before.
    """
    path = Path()
    try:
        with Postponed(), ExitStack() as stack:
            names: dict[Path, str] = {}
            for path, data in files.items():
                if path.is_dir():
                    raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
                _remove_stale(path)
                names[path] = str(path.parent / f"{_prefix(path)}{secrets.token_hex(8)}{_SUFFIX}")
                stack.callback(_remove, names[path])  # what is not renamed is removed at the end
                _write_down(names[path], data)
            # Every byte is on the disk by now, before the first old file goes.
            for path, name in names.items():
                os.replace(name, path)
            for path in without:
                if path not in files and path.is_file():
                    path.unlink()
            for folder in dict.fromkeys(path.parent for path in files):
                _flush_folder(folder)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        cure = _CURES.get(getattr(error, "errno", None) or 0, "Choose another folder with --out.")
        reason = getattr(error, "strerror", None) or error
        raise CertificateError(
            f"{path.name} cannot be written: {reason}.", key=str(path), cure=cure
        ) from error


def _write_down(name: str, data: bytes) -> None:
    """Write a new file, down to the disk."""
    # Not tempfile: its files are for the owner's eyes only, and these get the permissions of any
    # new file.
    descriptor = os.open(
        name, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666
    )
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def require_own(folder: Path, name: str, *, force: bool) -> Path:
    """Refuse a folder with results of another problem, or of none that can be read, unless
    ``force``.  SpecError."""
    held = [
        each
        for each in ("certificate.json", "problem.json", "report.html")
        if (folder / each).exists()
    ]
    if held and not force:
        there = _name_in(folder)
        if there != name:
            owner = f"{held[0]} of an unknown problem"
            if there:
                owner = f"the certificate of {another_problem(there, name)}"
            cure = (
                "Choose another folder with --out, or replace these files with --force (in "
                "Python: force=True)."
            )
            raise refused("--out", f"{str(folder)!r} holds {owner}.", cure)
    return folder


def another_problem(made: object, own: str) -> str:
    """How the problem ``made`` of a certificate is called beside the problem ``own`` of another
    hash."""
    if made == own:
        return f"another problem, an earlier or later version of {shown(made)}"
    return f"another problem, {shown(made)}"


def replaced_words(folder: Path, name: str, sha256: str) -> str | None:
    """Whose certificate one of this problem would replace in ``folder``, if not an own one."""
    try:
        there = hashlib.sha256((folder / "problem.json").read_bytes()).hexdigest()
    except OSError:
        return None
    # A certificate belongs to a problem by its hash; an edited file has another one.
    if there == sha256:
        return None
    return f"the certificate of {another_problem(_name_in(folder), name)} (its hash differs)"


def _name_in(folder: Path) -> object:
    """The name of the problem whose results a folder holds; None where that cannot be read."""
    try:
        return json.loads((folder / "problem.json").read_bytes())["name"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def write_folder(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write files into a folder by their names, which is made where it is missing; return their
    paths.  Raises: as ``write_together``."""
    make_folder(folder)
    paths = {folder / name: data for name, data in files.items()}
    write_together(paths)
    return list(paths)


def make_folder(path: Path) -> Path:
    """Make a folder if it is not there.  Raises CertificateError when that cannot be done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        what = (
            f"the folder {str(path)!r} cannot be made: {getattr(error, 'strerror', None) or error}."
        )
        raise CertificateError(what, key=str(path), cure="Choose another with --out.") from error
    return path


def _prefix(path: Path) -> str:
    return f".{path.name[:_LONGEST_NAME]}."


def _flush_folder(folder: Path) -> None:
    """Make the renames last through a power cut, where the system lets folders be opened."""
    # Windows, a folder that may be written and not read, a file system without it: the files
    # themselves are complete.
    with suppress(OSError), ExitStack() as stack:
        descriptor = os.open(folder, os.O_RDONLY)
        stack.callback(os.close, descriptor)
        os.fsync(descriptor)


def _remove_stale(path: Path) -> None:
    """Remove what writers of this file left behind that were killed long ago."""
    # A folder that cannot be listed, or another process that was faster: not worth a failure.
    with suppress(OSError), os.scandir(path.parent) as entries:
        for entry in entries:
            ours = entry.name.startswith(_prefix(path)) and entry.name.endswith(_SUFFIX)
            if ours and time.time() - entry.stat(follow_symlinks=False).st_mtime > STALE:
                _remove(entry.path)


def _remove(name: str) -> None:
    with suppress(OSError):  # renamed already, never made, or the disk is gone
        os.unlink(name)
