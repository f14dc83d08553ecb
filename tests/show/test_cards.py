"""Every public noun and result shows itself: in Jupyter, at the prompt, small for large problems,
text escaped."""

import ast
import inspect
import re
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from importlib import import_module
from importlib.util import resolve_name
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from certified import certified
from networks import linked, network_of
from reports import Page

import dobc_design as dd
from dobc_design._show import cards as _display
from dobc_design._show.cards import Card, Formula, html_of, latex_of, listed, plain

HOSTILE = "<script>alert('\"&')</script>"
LONGEST_HTML, LONGEST_TEXT = 30_000, 4_000  # characters
#: Classes of other packages, or of this one, that show themselves in a way of their own.
OTHERWISE = {"Designer": "_repr_mimebundle_", "Sheet": "_repr_png_"}

#: Public names of modules that have others as well.
INSIDE = {
    dd.signals: "Fixed Markov Mobile Periodic RandomDwell Schedule Waypoints",
    dd.poles: "Cone Disk HalfPlane NoiseLimit",
    dd.export: "to_c to_casadi to_control to_fmu to_latex to_numpy to_sdpa to_sympy",
}


def public() -> Iterator[object]:
    """All public names, those of the public modules included."""
    for name in sorted({*dd.__all__, *dd._HOMES} - {"Designer"}):
        yield getattr(dd, name)
    for name in dd.exact.__all__:
        yield getattr(dd.exact, name)
    for name, value in vars(dd.exosystems).items():
        if not name.startswith("_"):
            yield value
    for module, names in INSIDE.items():
        for name in names.split():
            yield getattr(module, name)


def is_ours(each: type) -> bool:
    """Whether it is a class of the package, and no mistake that is raised."""
    return each.__module__.startswith("dobc_design") and not issubclass(each, Exception)


@cache
def imported(module: str) -> dict[str, str]:
    """Name -> module of everything of the package that a module imports, also where only
    annotations need it."""
    found = import_module(module)
    tree = ast.parse(Path(inspect.getfile(found)).read_text("utf-8"))
    homes = {}
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom):
            continue
        home = resolve_name("." * node.level + (node.module or ""), found.__package__)
        if home.startswith("dobc_design"):
            for alias in node.names:
                homes[alias.name] = home
    return homes


def classes_in(annotation: str, module: str) -> Iterator[type]:
    """The classes of the package that an annotation names."""
    for name in re.findall(r"\b[A-Z]\w+", annotation):
        found = getattr(import_module(imported(module).get(name, module)), name, None)
        if inspect.isclass(found) and is_ours(found):
            yield found


def results_of(function: Any) -> Iterator[type]:
    returned = inspect.signature(function).return_annotation
    if isinstance(returned, str):
        yield from classes_in(returned, function.__module__)
    for each in (returned, *get_args(returned)):
        if inspect.isclass(each) and is_ours(each):
            yield each


@cache
def shown_types() -> dict[str, type]:
    """Public classes, what public functions return, and what methods and properties of public
    classes return."""
    found: dict[str, type] = {}
    for value in public():
        if inspect.isclass(value) and is_ours(value):
            found[value.__name__] = value
        elif inspect.isfunction(value) and value.__module__.startswith("dobc_design"):
            found |= {each.__name__: each for each in results_of(value)}
    for each in list(found.values()):
        for name, member in vars(each).items():
            function = getattr(member, "__func__", member)
            if isinstance(member, property):
                function = member.fget
            if not name.startswith("_") and inspect.isfunction(function):
                found |= {result.__name__: result for result in results_of(function)}
    return found


def test_every_public_noun_and_result_shows_itself_in_jupyter():
    types = shown_types()
    for name in ("Problem", "Certificate", "Recheck", "Searched", "Regions", "CCode", "RouthTable"):
        assert name in types
    assert silent(types) == []
    assert silent({"New": type("New", (), {})}) == ["New"]


def silent(types: dict[str, type]) -> list[str]:
    """Those that a notebook would show as plain text."""
    found = []
    for name, each in types.items():
        way = OTHERWISE.get(name, "_repr_html_")
        if not hasattr(each, way):
            found.append(name)
    return found


@pytest.fixture(scope="module")
def large() -> dd.Problem:
    """A path of 1000 agents with hostile names in 2 modes, all pinned, with a disturbance of order
    14."""
    names = [f"{HOSTILE}{i}" for i in range(1000)]
    arcs = [[names[i], names[i + 1]] for i in range(999)]
    modes = {HOSTILE: arcs, "b": arcs[:-1]}
    A = []
    for i in range(14):
        A.append([f"{i + 1}/{j + 7}" for j in range(14)])
    given: dict[str, Any] = {"name": HOSTILE, "notes": [HOSTILE] * 50}
    given["exosystem"] = dd.Exosystem(A=A, C=[[1] * 14])
    given["region"] = {"initial_states": [0, 5], "initial_disturbance": "1/3"}
    order = [HOSTILE, "b"] * 100
    given["switching"] = dd.Switching(signal="periodic", sequence=order, dwell=1)
    return linked(modes, names, "y + y**3", gains=1, offsets={names[0]: 1}, **given)


@pytest.fixture(scope="module")
def small() -> dd.Certificate:
    constant = dd.Exosystem(A=[[0]], C=[[1]])
    arcs = {HOSTILE: [[HOSTILE, "b"]]}
    problem = linked(arcs, None, "2*y", gains={"b": 1}, name=HOSTILE, exosystem=constant)
    return dd.certify(problem)


def signals(modes: tuple[str, ...]) -> Iterator[Any]:
    yield dd.signals.Fixed(mode=modes[0])
    yield dd.signals.Periodic(dwell=[0.5] * 2, order=modes)
    yield dd.signals.RandomDwell(dwell=0.5)
    yield dd.signals.Markov(generator=((-1, 1), (1, -1)), order=modes)
    yield dd.signals.Mobile(radius=2.0)
    yield dd.signals.Schedule(times=tuple(range(2000)), modes=modes * 1000)
    positions = np.zeros((30, 1000, 3)).tolist()
    yield dd.signals.Waypoints(times=tuple(range(30)), positions=positions)


def exact_nouns() -> Iterator[Any]:
    sparse = dd.exact.SparseSymmetric
    yield sparse(1000, {(i, i): Fraction(i + 1, 7) for i in range(1000)})
    yield sparse(2, {(0, 1): Fraction(1, 7)})
    yield dd.exact.Interval(Fraction(1, 3), Fraction(2))
    corner = sparse(1000, {(0, 0): Fraction(1)})
    yield dd.exact.IntegerSymmetric.from_sparse(corner)
    yield dd.exact.routh([1] * 200)
    zero = ((Fraction(0),),)
    yield dd.exact.decide_detectable(zero, zero)
    yield dd.exact.decide_positive_definite(dd.exact.identity(60))


def nouns(problem: dd.Problem) -> Iterator[Any]:
    yield problem
    yield problem.network
    yield problem.pinning
    yield problem.coupling
    yield problem.region
    yield problem.exosystem
    yield problem.observer
    yield problem.switching
    yield problem.groups[0]
    yield dd.Dynamics(A=np.eye(14).astype(int).tolist())
    yield dd.Readings(delay="0.1", lost=2, period="0.05")
    yield dd.Processor(period="0.05")
    yield dd.poles.HalfPlane(left_of=-2)
    yield dd.poles.Disk(centre=-3, radius=2)
    yield dd.poles.Cone(damping="0.7")
    yield dd.poles.NoiseLimit(bound=3)
    yield from signals(tuple(problem.network.modes))
    yield from exact_nouns()
    yield dd.exact.decide_observable(problem.exosystem.A, problem.exosystem.C)
    failures = [dd.Failure(agent=each) for each in problem.network.labels]
    yield failures[0]
    yield dd.Stress(noise=0.1, failures=failures)
    yield dd.Verdict.PROVED
    yield dd.Observer(W=[["16/5"], ["12/5"]], P=[[1, 0], [0, "1/3"]])
    components = problem.coupling.components
    yield dd.Coupling(components=components, by_component=True, dimension=3)


def checked(value: Any) -> str:
    """The page of a value, which is small, balanced, and free of foreign tags; its texts are
    short."""
    page: str = value._repr_html_()
    assert len(page) < LONGEST_HTML
    assert Page(page).wrong == []
    assert "<script" not in page
    assert _display.STYLE in page
    assert len(repr(value)) < LONGEST_TEXT
    latex = getattr(value, "_repr_latex_", lambda: None)()
    if latex is not None:
        assert len(latex) < LONGEST_TEXT
        assert latex.count("{") == latex.count("}")
    return page


def test_nouns_of_a_thousand_agents_are_shown_on_less_than_a_page(large: dd.Problem):
    seen = set()
    for value in nouns(large):
        seen.add(type(value).__name__)
        checked(value)
    page = checked(large)
    assert "14 × 14 matrix, too large to be shown" in page
    assert "and 988 more" in page
    rooms = ("dobc_design.problem", "dobc_design.coupling", "dobc_design.exact")
    for name, each in shown_types().items():
        if each.__module__.startswith(rooms):
            assert name in seen


def test_results_are_shown_with_their_verdict_and_without_foreign_tags(small: dd.Certificate):
    problem = small.problem
    run = dd.simulate(problem, t_final=0.5)
    certificate = checked(small)
    assert 'class="dobc-verdict dobc-proved"' in certificate
    named = [certificate, checked(small.regions)]
    named += [checked(dd.analyse(problem)), checked(run)]
    for page in named:
        assert "&lt;script&gt;" in page

    for check in small.checks[:3]:
        checked(check)
    checked(dd.verify(small, problem))
    checked(small.envelope(run))
    checked(dd.build_model(problem))
    checked(dd.design_observer(problem))
    checked(dd.design_pinning(problem, rate=0.1))
    checked(dd.falsify(problem, runs=3, t_final=0.5))


def test_mathematics_is_mathml_and_latex_and_text_says_what_was_typed():
    exosystem = dd.Exosystem(A=[[0, 2], [-2, 0]], C=[["1/3", 0]])
    page = exosystem._repr_html_()
    latex = exosystem._repr_latex_()
    assert page.count("<math") == 2
    assert latex.splitlines()[1] == r"$$ C = \begin{pmatrix} 0.33333 & 0 \end{pmatrix} $$"
    assert repr(dd.poles.Disk(centre="-7/2", radius=2)) == "Disk(centre=-7/2, radius=2)"
    assert repr(dd.Exosystem(A=[[0]], C=[[1]])) == "Exosystem(A=[[0]], C=[[1]])"
    network = network_of([[1, 2]])
    assert repr(network) == "<Network of 2 agents: G with 1 arc>"


def test_a_check_prints_itself_as_sentences_and_lines():
    certificate = certified("paper-fixed")
    told = str(certificate.check("max-separable")).splitlines()
    assert told[0].startswith("max-separable: PROVED. Every start with |e_i| <= 4 and |eps_i|")
    assert told[1] == "  starts: |e|_inf <= 4 and |eps_i| <= 0.5"
    refuted = certificate.check("theorem1-printed")
    assert str(refuted).endswith(f"\n  cure: {refuted.fix.text}")
    assert "=" not in repr(refuted).partition(":")[0]
    assert repr(refuted).startswith("<Check of theorem1-printed: REFUTED. Psi is not negative")


def test_numbers_that_are_claims_are_not_rounded_up(small: dd.Certificate):
    for check in small.checks:
        for name, value in check._card().facts:
            if name in ("margin", "rate in 1/s"):
                claimed = Fraction(repr(check.margin if name == "margin" else check.rate))
                assert abs(Fraction(value)) <= abs(claimed)


def test_long_things_are_cut_and_say_how_much_is_left_out():
    assert listed(range(20)) == "0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 and 8 more"
    assert plain({"a": "x" * 500}).endswith("…'}")
    rows = [(i,) for i in range(100)]
    card = Card(title="t", heads=("a",), rows=rows, hidden=7, lines=["s"] * 20)
    page = html_of(card)
    assert "and 67 more" in page
    assert "and 8 more" in page
    assert latex_of(card) is None
    assert latex_of(Card(title="t", facts=[("h", Formula("y^2"))])) == "$$ y^2 $$"
