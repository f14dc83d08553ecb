"""The exceptions of the toolbox: what went wrong, at which key, and what cures it.

The caller's mistake raises a SpecError (also a ValueError), a broken machine a SolverError or
CertificateError (also a RuntimeError); the mathematics' answer is never an exception but a
``Verdict``.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
MOST_ERRORS = 20  # of one kind in one file; more would hide the first

# loaded by every module that logs
logging.getLogger("dobc_design").addHandler(logging.NullHandler())


class DobcError(Exception):
    """Base of every error of the toolbox.

    Attributes: ``message`` says where, what must be, why and what it was; ``key`` is the key as the
    user typed it, or None; ``cure`` is the remedy, or None; ``kind`` is the word used in JSON.
    """

    kind = "error"

    def __init__(self, message: str, *, key: str | None = None, cure: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.key = key
        self.cure = cure

    def __str__(self) -> str:
        """Return the message, then the cure, on one line unless the message has several."""
        if not self.cure:
            return self.message
        joint = " " if self.message.endswith((".", "?", "!")) else "; "
        return self.message + joint + self.cure


def reason_of(error: Exception) -> str:
    """What is wrong with a file whose reading raised this, in words of the file and not of
    Python."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, KeyError):
        return f"it has no {error}"
    if isinstance(error, UnicodeDecodeError):
        return f"byte {error.start} is not UTF-8"
    return (
        str(error)
        if isinstance(error, (DobcError, ValueError, SyntaxError))
        else "a value in it is of the wrong kind"
    )


class SpecError(DobcError, ValueError):
    """The problem as given cannot be used: the caller's mistake."""

    kind = "spec"

    _parts: tuple[SpecError, ...] = ()

    @property
    def errors(self) -> tuple[SpecError, ...]:
        """The single errors this one consists of; (self,) unless made by ``several``."""
        return self._parts or (self,)

    @classmethod
    def several(cls, errors: Sequence[SpecError]) -> SpecError:
        """Join errors into one that shows each on its own line.

        A single error comes back as it is, nested ones are flattened. Raises ValueError on none.
        """
        parts = tuple(part for error in errors for part in error.errors)
        if not parts:
            raise ValueError("SpecError.several needs at least one error; got none")
        if len(parts) == 1:
            return parts[0]
        joined = SpecError("\n".join(str(part) for part in parts))
        joined._parts = parts
        return joined


class ShapeError(SpecError):
    """A matrix or vector has the wrong shape, or is not symmetric where it must be."""

    kind = "shape"


class ExpressionError(SpecError):
    """A coupling expression cannot be read, or does not mean what a coupling must mean."""

    kind = "expression"


def wrong(key: str, what: str, cure: str | None = None) -> SpecError:
    """Return the error "KEY WHAT" about a key."""
    return SpecError(f"{key} {what}", key=key, cure=cure)


def misshapen(key: str, what: str, cure: str | None = None) -> ShapeError:
    """Return the error "KEY WHAT" about the shape of what stands under a key."""
    return ShapeError(f"{key} {what}", key=key, cure=cure)


def misstated(key: str, what: str, cure: str | None = None) -> ExpressionError:
    """Return the error "KEY WHAT" about an expression."""
    return ExpressionError(f"{key} {what}", key=key, cure=cure)


def about(
    key: str, what: str, cure: str | None = None, *, kind: type[SpecError] = SpecError
) -> SpecError:
    """Return the error "KEY: WHAT" about a key."""
    return kind(f"{key}: {what}", key=key, cure=cure)


def refused(key: str | None, message: str, cure: str | None = None) -> SpecError:
    """Return the error about a key whose message is a sentence of its own."""
    return SpecError(message, key=key, cure=cure)


class Mistakes(list[SpecError]):
    """Errors that are kept while more is read, so that all are told at once: ``with errors:`` keeps
    what is raised inside."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if not isinstance(error, SpecError):
            return False
        self.extend(error.errors)
        return True

    def tried(self, part: Callable[P, T], *given: P.args, **named: P.kwargs) -> T | None:
        """What ``part`` returns, or None when it raises a SpecError, which is kept."""
        with self:
            return part(*given, **named)
        return None

    def few(self, values: Iterable[T]) -> Iterator[T]:
        """These values one after the other, as long as there are fewer than twenty mistakes."""
        for value in values:
            yield value
            if len(self) >= MOST_ERRORS:
                return

    def raise_all(self) -> None:
        """Raise the errors as one, if there are any."""
        if self:
            raise SpecError.several(self)


class SolverError(DobcError, RuntimeError):
    """A numerical solver broke down; this says nothing about the problem."""

    kind = "solver"


class CertificateError(DobcError, RuntimeError):
    """A certificate cannot be made, read or trusted."""

    kind = "certificate"
