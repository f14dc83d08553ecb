"""Options in groups: a command takes a small noun for each group, and the command line has its
fields as options."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints


def in_groups(command: Callable[..., None]) -> Callable[..., None]:
    """The command as typer reads it: in place of every parameter that is a frozen dataclass stand
    its fields.

    A field is written as an option is, with ``Annotated`` and a default.  Only what the groups
    check by themselves can fail when they are made, and a SpecError is then told as one of the
    command.
    """
    taken = signature(command, eval_str=True).parameters
    groups: dict[str, Any] = {
        name: each.annotation for name, each in taken.items() if is_dataclass(each.annotation)
    }
    options: list[Parameter] = []
    for name, parameter in taken.items():
        if name in groups:
            options += _options_of(groups[name])
        else:
            options.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))

    def run(**given: Any) -> None:
        for name, noun in groups.items():
            given[name] = noun(**{each.name: given.pop(each.name) for each in fields(noun)})
        command(**given)

    run.__name__, run.__doc__, run.__module__ = (
        command.__name__,
        command.__doc__,
        command.__module__,
    )
    run.__signature__ = Signature(options)  # type: ignore[attr-defined]  # what inspect, and so typer, looks for
    run.__annotations__ = {each.name: each.annotation for each in options}
    return run


def _options_of(noun: Any) -> list[Parameter]:
    types = get_type_hints(noun, include_extras=True)
    return [
        Parameter(
            each.name, Parameter.KEYWORD_ONLY, default=each.default, annotation=types[each.name]
        )
        for each in fields(noun)
    ]
