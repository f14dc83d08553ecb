"""Tables of a problem file as nouns whose fields say how their keys are read."""

from collections.abc import Callable
from dataclasses import field, fields
from typing import Any, Self

from dobc_design._checks import LATER, put
from dobc_design._show.cards import Card, Shown
from dobc_design.errors import Mistakes
from dobc_design.exact.reading import keyed

Read = Callable[[Any, str], Any]  # of a value and its key


def read_by(read: Read, default: Any = None, *, later: bool = False) -> Any:
    """A field that is read by a function of its value and its key, unless it is None.  ``later``:
    problem.json has it only where it was given."""
    return field(default=default, metadata={"read": read, **(LATER if later else {})})


class Stated(Shown):
    """A table that is read field by field.  Raises: SpecError that names every wrong key."""

    __slots__ = ()

    def __post_init__(self) -> None:
        noun: Any = self
        errors = Mistakes()
        for each in fields(noun):
            value, key = getattr(noun, each.name), f"{type(self).__name__.lower()}.{each.name}"
            if value is not None:
                with errors:
                    put(self, **{each.name: each.metadata["read"](value, key)})
        errors.raise_all()

    @classmethod
    def stated(cls, value: Any) -> Self | None:
        """What a table states, or the noun itself, as it was made in Python.  Raises: SpecError."""
        if value is None or isinstance(value, cls):
            return value
        noun: Any = cls
        names = [each.name for each in fields(noun)]
        given = zip(names, keyed(value, names, key=cls.__name__.lower()), strict=True)
        return cls(**{name: each for name, each in given if each is not None})

    def _card(self) -> Card:
        noun: Any = self
        facts = [(each.name, value) for each in fields(noun) if (value := getattr(self, each.name))]
        return Card(title=type(self).__name__, text="at most", facts=facts)
