"""Writing files: the old one or the new one, never a part, and nothing left behind."""

from __future__ import annotations

import os
import stat

import pytest

from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.errors import CertificateError


@pytest.mark.parametrize("old", [b"old", None])
@pytest.mark.parametrize("step", ["fsync", "replace", "open", "fdopen"])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt(), MemoryError()])
def test_an_interrupted_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, old, step, failure):
    target = tmp_path / "certificate.json"
    if old is not None:
        target.write_bytes(old)

    def broken(*args, **kwargs):
        raise failure

    monkeypatch.setattr(os, step, broken)
    expected = CertificateError if isinstance(failure, OSError) else type(failure)
    with pytest.raises(expected):
        write_atomically(target, b"new")
    monkeypatch.undo()
    assert (target.read_bytes() if target.exists() else None) == old
    assert [path.name for path in tmp_path.iterdir()] == ([] if old is None else [target.name])


def test_a_write_replaces_the_whole_file_and_can_be_read_by_others(tmp_path):
    target = tmp_path / "certificate.json"
    write_atomically(target, b"long old content")
    write_atomically(target, b"new")
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) & 0o444 == 0o444
    assert [path.name for path in tmp_path.iterdir()] == ["certificate.json"]


def test_a_folder_that_is_not_there_is_an_error_with_a_cure(tmp_path):
    with pytest.raises(CertificateError, match="cannot be written") as caught:
        write_atomically(tmp_path / "absent" / "certificate.json", b"x")
    assert "--out" in caught.value.cure


def test_folders_are_made_with_their_parents(tmp_path):
    assert make_folder(tmp_path / "a" / "b").is_dir()
    assert make_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(CertificateError, match="cannot be made"):
        make_folder(tmp_path / "file")
