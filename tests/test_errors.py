"""The exceptions: what they carry, what they subclass, how they read."""

import pickle

import pytest

from dobc_design import errors
from dobc_design.errors import (
    CertificateError,
    DobcError,
    ExpressionError,
    ShapeError,
    SolverError,
    SpecError,
)


def test_an_error_carries_message_key_and_cure():
    """Style page: errors say where, must what, got which, and the remedy."""
    error = DobcError("rate must be positive; got -1.", key="observer.rate", cure="Leave it out.")
    assert error.message == "rate must be positive; got -1."
    assert error.key == "observer.rate"
    assert error.cure == "Leave it out."


@pytest.mark.parametrize(
    ("message", "text"),
    [
        ("it must vanish at 0", "it must vanish at 0; add - 1"),
        ("it must vanish.", "it must vanish. add - 1"),
    ],
)
def test_the_text_is_the_message_then_the_cure(message, text):
    """Architecture, floor 0: str() = message, then cure."""
    assert str(DobcError(message, cure="add - 1")) == text
    assert str(DobcError(message)) == message


@pytest.mark.parametrize("kind", [SpecError, ShapeError, ExpressionError])
def test_the_callers_mistakes_are_value_errors(kind):
    """Style page: the caller's mistake raises a ValueError."""
    with pytest.raises(ValueError, match=r"^wrong$"):
        raise kind("wrong")
    assert issubclass(kind, SpecError)


@pytest.mark.parametrize("kind", [SolverError, CertificateError])
def test_broken_machines_are_runtime_errors(kind):
    """Style page: a broken machine raises."""
    with pytest.raises(RuntimeError, match=r"^broke$"):
        raise kind("broke")


def test_every_kind_has_its_own_word():
    """The word is what JSON shows; two classes with one word could not be told apart."""
    kinds = [
        value.kind
        for value in vars(errors).values()
        if isinstance(value, type) and issubclass(value, DobcError)
    ]
    assert len(kinds) == len(set(kinds)) == 6


def test_one_error_lists_itself_and_several_of_none_are_refused():
    """Architecture, floor 0: .errors lists them; default (self,)."""
    error = SpecError("wrong")
    assert error.errors == (error,)
    # Nothing to join: class and key stay.
    error = ShapeError("C is wrong", key="C")
    assert SpecError.several([error]) is error
    # There is nothing to raise.
    with pytest.raises(ValueError, match="at least one error"):
        SpecError.several([])


def test_several_errors_show_each_on_its_own_line():
    """Contract: all errors of a file at once."""
    first = SpecError("a is wrong", cure="mend a")
    second = ShapeError("C is wrong", key="C")
    joined = SpecError.several([first, SpecError.several([second, first])])
    assert joined.errors == (first, second, first)
    assert str(joined).splitlines() == ["a is wrong; mend a", "C is wrong", "a is wrong; mend a"]


def test_errors_survive_pickling():
    """Sweeps send them between processes."""
    joined = SpecError.several([SpecError("a", key="k", cure="c"), ExpressionError("b")])
    again = pickle.loads(pickle.dumps(joined))
    assert str(again) == str(joined)
    assert again.errors[0].key == "k"
    assert again.errors[0].cure == "c"
    assert type(again.errors[1]) is ExpressionError
