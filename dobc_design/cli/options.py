"""Options in groups: a command takes a small noun for each group, and the command line has its
fields as options."""

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
    groups: dict[str, Any] = {}
    options: list[Parameter] = []
    for name, parameter in taken.items():
        if is_dataclass(parameter.annotation):
            groups[name] = parameter.annotation
            options += _options_of(parameter.annotation)
        else:
            options.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))

    def run(**given: Any) -> None:
        for name, noun in groups.items():
            own = {each.name: given.pop(each.name) for each in fields(noun)}
            given[name] = noun(**own)
        command(**given)

    run.__name__ = command.__name__
    run.__doc__ = command.__doc__
    run.__module__ = command.__module__
    run.__annotations__ = {each.name: each.annotation for each in options}
    # what inspect, and so typer, looks for
    run.__signature__ = Signature(options)  # type: ignore[attr-defined]
    return run


def _options_of(noun: Any) -> list[Parameter]:
    """The fields of a group as parameters."""
    types, kind = get_type_hints(noun, include_extras=True), Parameter.KEYWORD_ONLY
    return [
        Parameter(each.name, kind, default=each.default, annotation=types[each.name])
        for each in fields(noun)
    ]
