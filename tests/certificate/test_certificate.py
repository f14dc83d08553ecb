"""The certificate as an object, shown safely; files: the old one or the new one, never a part."""

import os
from fractions import Fraction

import pytest
from certified import certified

from dobc_design import Network, Problem, Verdict, certify, verify
from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.certificate.text import read_claims
from dobc_design.errors import CertificateError
from dobc_design.problem.canonical import problem_from_canonical


def test_saved_files_are_enough_to_check_it_again(tmp_path):
    certificate = certified("paper-fixed")
    claims_file, problem_file = certificate.save(tmp_path / "out")
    problem = problem_from_canonical(problem_file.read_bytes())
    assert problem == certificate.problem
    assert read_claims(claims_file.read_bytes()) == certificate.claims
    assert verify(claims_file.read_bytes(), problem).holds
    files = (tmp_path / "out").iterdir()
    names = sorted(path.name for path in files)
    assert names == ["certificate.json", "problem.json"]


def test_the_gain_is_an_array_with_the_exact_matrix_beside_it():
    certificate = certified("paper-switching")
    assert certificate.W.tolist() == [[3.2], [2.4]]
    first = (Fraction(16, 5),)
    second = (Fraction(12, 5),)
    assert certificate.W_exact == (first, second)
    arcs = [[1, 2]]
    network = Network.from_arcs(arcs, arrow="listens_to")
    alone = Problem(network=network, coupling="y", gains=1)
    assert certify(alone).W is None
    assert certify(alone).W_exact is None


def test_checks_are_found_by_id_and_mode():
    certificate = certified("paper-switching")
    assert certificate.check("lemma1", "Gb").mode == "Gb"
    assert certificate.check("theorem2").verdict is Verdict.PROVED
    with pytest.raises(KeyError, match="no check 'theorem1'"):
        certificate.check("theorem1")


def test_a_certificate_shows_itself_in_a_notebook_as_html_latex_and_text():
    """Contract: _repr_html_, _repr_latex_, _repr_mimebundle_."""
    certificate = certified("paper-fixed")
    bundle = certificate._repr_mimebundle_()
    assert set(bundle) == {"text/plain", "text/html", "text/latex"}
    assert "proved" in certificate._repr_latex_()
    assert "<table>" in certificate._repr_html_()


@pytest.mark.parametrize("old", [b"old", None])
@pytest.mark.parametrize("step", ["fsync", "replace", "open", "fdopen"])
@pytest.mark.parametrize(
    "failure", [OSError(28, "No space left on device"), KeyboardInterrupt(), MemoryError()]
)
def test_an_interrupted_write_leaves_the_old_file_and_no_other(
    tmp_path, monkeypatch, old, step, failure
):
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
    names = [path.name for path in tmp_path.iterdir()]
    assert names == ([] if old is None else [target.name])


def test_folders_are_made_with_their_parents_and_what_cannot_be_is_an_error_with_a_cure(tmp_path):
    with pytest.raises(CertificateError, match="cannot be written") as caught:
        write_atomically(tmp_path / "absent" / "certificate.json", b"x")
    assert "--out" in caught.value.cure
    assert make_folder(tmp_path / "a" / "b").is_dir()
    assert make_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(CertificateError, match="cannot be made"):
        make_folder(tmp_path / "file")
