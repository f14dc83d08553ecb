"""[exosystem] and [[exosystem.groups]] of a problem file: matrices or a kind into Exosystems, groups into Groups.

What the tables may hold is said by ``schema``; who is in which group is checked by ``groups``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.reading import is_list, is_text, shown
from dobc_design.problem import exosystems
from dobc_design.problem.exosystem import Exosystem
from dobc_design.problem.groups import Group, group_key, renamed
from dobc_design.problem.observer import Observer
from dobc_design.problem.schema import ExosystemTable, GroupTable, ProblemFile

_EXAMPLES = {"A": "A = [[0, 2], [-2, 0]]", "C": "C = [[1, 0]]"}


def read_exosystem(
    tables: ProblemFile, *, dimension_of: Callable[[Exosystem | None], int]
) -> tuple[Exosystem | None, tuple[Group, ...]]:
    """The exosystem of the agents in no group, and the groups.

    ``dimension_of`` says how many state components there are, for the first exosystem given by A and C, or None;
    an exosystem given by its kind has that many components.
    Raises: SpecError naming the keys.
    """
    table = tables.exosystem
    if table is None:
        return None, ()
    errors: list[SpecError] = []
    own = _explicit(table, number=None, errors=errors)
    groups = [_explicit(group, number=number, errors=errors) for number, group in enumerate(table.groups)]
    if errors:
        raise SpecError.several(errors)
    m = dimension_of(next((each for each in (own, *groups) if each is not None), None))
    own = own or _of_kind(table, number=None, components=m, errors=errors)
    result = []
    for number, (each, found) in enumerate(zip(table.groups, groups, strict=True)):
        exosystem = found or _of_kind(each, number=number, components=m, errors=errors)
        try:
            observer = Observer(W=each.W, P=each.P)
            if exosystem is not None:
                agents = _labels(each.agents, key=f"{group_key(number)}.agents")
                result.append(Group(agents=agents, exosystem=exosystem, observer=observer))
        except SpecError as error:
            errors.append(renamed(error, number))
    if errors:
        raise SpecError.several(errors)
    return own, tuple(result)


def _explicit(table: ExosystemTable | GroupTable, *, number: int | None, errors: list[SpecError]) -> Exosystem | None:
    """The exosystem of A and C; None where a kind stands in their place, or where groups alone are given."""
    place = "exosystem" if number is None else group_key(number)
    matrices = [name for name in ("A", "C") if getattr(table, name) is not None]
    if table.kind is None and table.frequencies is not None:
        errors.append(_wrong(f"{place}.frequencies", 'belongs to kind = "harmonics"', "Give the kind, or remove it."))
    if table.kind is not None and matrices:
        both = f"stands beside {' and '.join(matrices)}, and one of them would be ignored"
        errors.append(_wrong(f"{place}.kind", both, "Give either A and C or the kind."))
    if table.kind is not None or (isinstance(table, ExosystemTable) and table.groups and not matrices):
        return None
    for name in ("A", "C"):
        if name not in matrices:
            errors.append(_wrong(f"{place}.{name}", "is required and missing", f"Write {_EXAMPLES[name]}."))
    if len(matrices) < 2:
        return None
    try:
        return Exosystem(A=table.A, C=table.C)
    except SpecError as error:
        errors.append(error if number is None else renamed(error, number))
        return None


def _of_kind(
    table: ExosystemTable | GroupTable, *, number: int | None, components: int, errors: list[SpecError]
) -> Exosystem | None:
    if table.kind is None:
        return None
    try:
        return exosystems.of_kind(table.kind, frequencies=table.frequencies, components=components)
    except SpecError as error:
        place = "exosystem" if number is None else group_key(number)
        for each in error.errors:
            key = f"{place}.{(each.key or 'kind').removeprefix('exosystem.')}"
            message = each.message.replace(each.key or "", key, 1)
            errors.append(type(each)(message, key=key, cure=each.cure))
        return None


def _labels(value: Any, *, key: str) -> list[Any]:
    if not is_list(value) or not value or not all(is_text(each) or isinstance(each, str | int) for each in value):
        raise _wrong(key, f"must be a list of labels, at least one; got {shown(value)}", "For example agents = [1, 2].")
    return list(value)


def _wrong(key: str, what: str, cure: str) -> SpecError:
    return SpecError(f"{key} {what}.", key=key, cure=cure)
