"""A problem described: what `dobc check` prints, as an object that shows itself in Jupyter."""

from dataclasses import replace

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.description import words
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem

from .contradictions import warnings
from .meaning import remarks, time_words


@noun
class Description(Shown):
    """A problem in words: its tables, time scales, warnings, and what may be a slip."""

    problem: Problem

    def __str__(self) -> str:
        return words.describe(self.problem)

    def __repr__(self) -> str:
        return str(self)

    def _card(self) -> Card:
        problem = self.problem
        card = problem._card()
        facts = [*card.facts, *words.disturbance_facts(problem)]
        times = time_words(problem)
        if times:
            facts.append(("time scales", times))
        facts += [("warning", warning) for warning in warnings(problem)]
        facts += [("look at this", remark) for remark in remarks(problem)]
        return replace(card, facts=facts)


def describe(problem: Source) -> Description:
    """Say in words what a problem says: who listens to whom, what every table of the file means,
    and what looks like a slip.

    ``problem`` is a Problem, a path or a built-in name.
    Returns: a Description, which shows itself as text and in Jupyter.  Raises: SpecError for a
    wrong problem.
    Example:
        >>> print(str(dd.describe("paper-fixed")).splitlines()[0])
        paper-fixed: 10 agents, 10 arcs, labels 1 to 10.
    """
    return Description(problem=with_observer(load_problem(problem)))
