"""Broken input for every reader, and what each reader may do with it.

A target takes bytes and returns normally, whether it accepted them or refused them in the one way
it may; anything else (another exception, a wrong round trip, more than LIMIT seconds of CPU time)
is a defect. ``seeds`` are valid inputs, ``mutate`` breaks them; the same seed breaks them in the
same way.
"""

import json
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from random import Random

import numpy as np
from bad_files import BAD_FILES, CSV, VALID
from broken_certificates import mutate as mutate_tree
from certified import certified, without_region

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes, read_claims
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.coupling.coupling import make_coupling
from dobc_design.coupling.expression import (
    Expression,
    numpy_function,
    parse_expression,
    polynomial_degree,
)
from dobc_design.coupling.tree import GradientAlgebra, IntervalAlgebra, evaluate, variable_names
from dobc_design.errors import CertificateError, ExpressionError, SpecError
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.problem.arcs_file import read_arcs_file
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.load import builtin_names, builtin_text, load_problem, read_problem_text

LONG = ("karate-club", "microgrid-ieee14", "uav-swarm")
LIMIT = 2.0  # seconds of CPU time for one input
LARGEST = 200_000  # bytes of a mutant

_WORDS = r"""
0 1 -1 1e400 1e-400 1e401 1e999999999 0.1 1/0 1/3 -9/8 nan inf NaN Infinity true false null 1_000
0x1F
1e5 ٣ +1 --1 1. .5
" ' \ \u0000 \ud800 \uD83D # , : = . ; [ ] { } [[ ]] ( ) < > & a.b.c.d [1,2] [1,2,3] [] {} [[]] ""
"\n"
y y1 y2 y3 pi exp( log( sqrt( tan( abs( min( max( clip( sinh( ** **64 **-64 **0.5 **2 * / + - 1e300
1e-300
exp(exp(exp(y))) y**64**2 1970-01-01 12:00:00 1970-01-01T00:00:00Z __import__ proved refuted
undecided theorem1 vector
global dobc-problem version 1,2,1 from,to,weight
"""
_QUOTES = ('"""', "'''", "\r\n", "\x1b[31m", "<edge source='1'/>")
_LONG = ("9" * 300, "9" * 5000, "[" * 60, "{" * 60, "(" * 60, "a." * 60)
_TEXTS = (*_WORDS.split(), *_QUOTES, *_LONG, *"\x00\ufeff\u202e\u2028\n\r\t \ud800é東\x7f\x85\xa0")
_BYTES = (b"\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\x1f\x8b\x08\x00", b"\xef\xbb\xbf")
TOKENS = (*(text.encode("utf-8", "surrogatepass") for text in _TEXTS), *_BYTES)

_EXPRESSIONS = """
y; exp(y) - 1 + y; tanh(y); 2*y - y**3; sin(y)/2 + 1e-3*y; clip(y, -1, 1) + y/3; y*abs(y); log(1 +
y/9)
sinh(y)*exp(-y**2); (1 + y**2)**(1/2) - 1; min(y, 1/2, 3*y); max(-3/4, y); tan(y/4); atan(y) -
y**5/7; cosh(y) - 1 + 2*y
y/(2 + y**2); sqrt(4 + y) - 2; sin(pi*y); ((((y))))**-2*y**3; 1e-400*y; -y - -y; y1*cos(y2)
log(1 + y2/9) + abs(y1 - 1) - 1; max(y1, y2/2 - 1) - y2/2"""
EXPRESSIONS = [text for line in _EXPRESSIONS.strip().splitlines() for text in line.split("; ")]

GRAPHML = b"""<graphml><key id="w" for="edge" attr.name="weight"><default>2</default></key>
<graph edgedefault="directed"><edge source="1" target="2"><data key="w">1/2</data></edge>
<edge source="2" target="3" directed="false"/></graph></graphml>"""

GML = (
    b'graph [ directed 1 node [ id 1 label "1" ] node [ id 2 label "2" ] edge [ source 1 '
    b"target 2 weight 0.5 ] ]"
)
PAJEK = b'*Vertices 3\n1 "1" 0.1 0.2\n2 "2"\n*Arcs\n1 2 0.5\n*Edges\n2 3 1\n'
MATRIX = b"%%MatrixMarket matrix coordinate real symmetric\n% x\n3 3 2\n2 1 0.5\n3 2 1e0\n"

# The first byte says which kind of file it is, see read_arcs.
ARCS = (
    *(
        b"5" + text
        for text in (CSV, b"from,to\n1,2\n", b"Source;Target;Type;Weight\n1;2;Undirected;0.5\n")
    ),
    *(b"1" + text for text in (b"1 2 0.5 # x\n2 3\n", b"1 2 {'weight': 2.0}\n", b"a, b\n1, 2\n")),
    b"0" + GRAPHML,
    b"2" + GML,
    b"3" + PAJEK,
    b"4" + MATRIX,
)

BOXES = tuple(
    Interval(Fraction(lo), Fraction(hi))
    for lo, hi in (
        ("0", "0"),
        ("-1e-9", "1e-9"),
        ("-1/2", "2"),
        ("1", "1"),
        ("-40", "300"),
        ("1e30", "1e31"),
    )
)


class Hang(BaseException):
    """An input took longer than LIMIT."""


class Wrong(AssertionError):
    """An input was accepted and misunderstood."""


@dataclass(frozen=True, kw_only=True)
class Target:
    name: str
    run: Callable[[bytes], bool]  # True: accepted; False: refused as it must be
    seeds: Callable[[], tuple[bytes, ...]]
    is_json: bool = False  # half of the mutants are then changed as trees and written as JSON again


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def defect(target: Target, data: bytes) -> str:
    """What is wrong with how a reader takes an input; "" if nothing."""
    try:
        with time_limit(LIMIT):
            target.run(data)
    except Hang:
        return f"more than {LIMIT} s"
    except Exception as error:  # noqa: BLE001 - that is what is being looked for
        return f"{type(error).__name__}: {str(error)[:200]}"
    return ""


def mutate(data: bytes, r: Random, *, others: tuple[bytes, ...] = ()) -> bytes:
    """A copy with one to six random changes: bytes, tokens, pieces moved, repeated, dropped,
    borrowed."""
    for _ in range(r.choice((1, 1, 1, 2, 3, 6))):
        data = _changed(data, r, others)[:LARGEST]
    return data


def _changed(data: bytes, r: Random, others: tuple[bytes, ...]) -> bytes:
    a = r.randrange(len(data) + 1)
    lengths = (1, 1, 2, 4, 10, 40, 200)
    end = a + r.choice(lengths)
    b = min(len(data), end)
    match r.randrange(9):
        case 0:
            byte = bytes([r.randrange(256)])
            head = data[:a] + byte
            return head + data[a + 1 :]
        case 1:
            return data[:a] + data[b:]
        case 2:
            times = r.choice((1, 1, 2, 30, 300))
            again = data[a:b] * times
            start = data[:b] + again
            return start + data[b:]
        case 3:
            c = r.randrange(len(data) + 1)
            rest = data[:a] + data[b:]
            return rest[:c] + data[a:b] + rest[c:]
        case 4:
            other = r.choice(others or (data,))
            c = r.randrange(len(other) + 1)
            inserted = other[c : c + r.choice((4, 20, 100))]
            return data[:a] + inserted + data[b:]
        case 5 | 6:
            return data[:a] + r.choice(TOKENS) + data[b:]
        case 7:
            return data[:a] + r.choice(TOKENS) + data[a:]
        case _:
            return _number_changed(data, r)


def _number_changed(data: bytes, r: Random) -> bytes:
    places = []
    for k in range(len(data)):
        starts_number = data[k : k + 1].isdigit()
        if starts_number and not data[k - 1 : k].isdigit():
            places.append(k)
    if not places:
        return data
    a = b = r.choice(places)
    while data[b : b + 1].isdigit():
        b += 1
    return data[:a] + r.choice(TOKENS) + data[b:]


def read_toml(data: bytes) -> bool:
    try:
        problem = read_problem_text(data, folder=None)
    except SpecError as error:
        return _refused(error)
    written = canonical_bytes(problem)
    if problem_from_canonical(written) != problem:
        raise Wrong("the canonical form is another problem")
    return True


def read_canonical(data: bytes) -> bool:
    try:
        problem = problem_from_canonical(data)
    except SpecError as error:
        return _refused(error)
    written = canonical_bytes(problem)
    if canonical_bytes(problem_from_canonical(written)) != written:
        raise Wrong("writing and reading changes the problem")
    return True


def read_expression(data: bytes) -> bool:
    """Parse, write, read, evaluate, enclose; the value has to lie in its enclosure."""
    text = data.decode("utf-8", "surrogateescape")
    dimension = 2 if "y2" in text else 1
    try:
        expression = parse_expression(text, dimension=dimension)
    except ExpressionError as error:
        return _refused(error)
    if parse_expression(str(expression), dimension=dimension) != expression:
        raise Wrong("the canonical text is another function")
    if not expression.latex or variable_names(dimension)[0] not in ("y", "y1"):
        raise Wrong("no LaTeX")
    polynomial_degree(expression.node)
    function = numpy_function(expression)
    for box in BOXES:
        _check_enclosure(expression, box, function)
    try:
        make_coupling(text, dimension=dimension, key="coupling.h")
    except SpecError as error:
        return _refused(error)
    return True


def _check_enclosure(
    expression: Expression, box: Interval, function: Callable[..., np.ndarray]
) -> None:
    node = expression.node
    dimension = expression.dimension
    try:
        enclosed = evaluate(node, (box,) * dimension, IntervalAlgebra())
    except UndefinedError:
        return
    algebra = GradientAlgebra(dimension)
    try:
        gradient = evaluate(node, algebra.variables((box,) * dimension), algebra)
    except UndefinedError:
        pass
    else:
        if len(gradient.partials) != dimension:
            raise Wrong("a slope is missing")
    for point in (box.lo, box.midpoint, box.hi):
        exact = evaluate(node, (Interval.point(point),) * dimension, IntervalAlgebra())
        if not (enclosed.lo <= exact.hi and exact.lo <= enclosed.hi):
            raise Wrong("a value lies outside its enclosure")
    function(np.full(dimension, float(box.midpoint)) if dimension > 1 else float(box.midpoint))


def read_arcs(data: bytes) -> bool:
    suffixes = (".graphml", ".edges", ".gml", ".net", ".mtx", ".csv", ".csv", ".csv")
    suffix = suffixes[data[0] % len(suffixes)] if data else ".csv"
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, f"arcs{suffix}").write_bytes(data[1:])
        index = {str(i + 1): i for i in range(4)}
        try:
            read_arcs_file(
                f"arcs{suffix}",
                folder=Path(folder),
                index=index,
                arrow="listens_to",
                key="network.modes.G",
            )
        except SpecError as error:
            return _refused(error)
    return True


def read_certificate(data: bytes) -> bool:
    """Read; what can be read is checked against the problem it names, and never crashes the
    checker."""
    try:
        claims = read_claims(data)
    except CertificateError as error:
        return _refused(error)
    for problem in _problems():
        if problem.name == claims.problem_name:
            recheck(claims, problem)
    return True


def check_certificate(data: bytes) -> bool:
    """The lone checker, given the trusted problem that the certificate names (or the first)."""
    problem = next((p for p in _problems() if f'"{p.name}"'.encode() in data), _problems()[0])
    return _examined(data, canonical_bytes(problem))


def check_problem(data: bytes) -> bool:
    """The lone checker, given a certificate and a problem that is broken."""
    return _examined(_certificates()[0], data)


def _examined(certificate: bytes, problem: bytes) -> bool:
    try:
        checker.examine(certificate, problem)
    except checker.Refused:
        return False
    return True


def _refused(error: SpecError | CertificateError) -> bool:
    text = str(error)
    if not text.isprintable() and any(not line.isprintable() for line in text.split("\n")):
        raise Wrong(f"a message that moves the cursor: {text!r}")
    if len(text) > 20_000:
        raise Wrong(f"a message of {len(text)} characters")
    return False


@cache
def _problems() -> tuple[dd.Problem, ...]:
    # that takes 7 s
    names = []
    for name in builtin_names():
        if load_problem(name).n <= 20 and name != "neurons":
            names.append(name)
    # A mutant has 2 s; the regions of some problems take longer than that to check as they are.
    return tuple(without_region(name) if name in LONG else load_problem(name) for name in names)


def _toml_seeds() -> tuple[bytes, ...]:
    short = []
    for case in BAD_FILES[::50]:
        if not callable(case.content):
            short.append(case.data())
    valid = [VALID.encode()] * 6
    return (*(builtin_text(name).encode() for name in builtin_names()), *valid, *short)


@cache
def _certificates() -> tuple[bytes, ...]:
    names = {load_problem(name): name for name in builtin_names()}
    return tuple(
        certificate_bytes(certified(names.get(problem, problem)).claims) for problem in _problems()
    )


@cache
def _canonical_seeds() -> tuple[bytes, ...]:
    return tuple(map(canonical_bytes, _problems()))


def _targets() -> Iterator[Target]:
    yield Target(name="problem.toml", run=read_toml, seeds=cache(_toml_seeds))
    yield Target(
        name="problem.json",
        run=read_canonical,
        seeds=_canonical_seeds,
        is_json=True,
    )
    yield Target(
        name="expression",
        run=read_expression,
        seeds=lambda: tuple(text.encode() for text in EXPRESSIONS),
    )
    yield Target(name="arcs file", run=read_arcs, seeds=lambda: ARCS)
    yield Target(name="certificate.json", run=read_certificate, seeds=_certificates, is_json=True)
    yield Target(
        name="checker, certificate", run=check_certificate, seeds=_certificates, is_json=True
    )
    yield Target(
        name="checker, problem",
        run=check_problem,
        seeds=_canonical_seeds,
        is_json=True,
    )


TARGETS = tuple(_targets())


def mutants(target: Target, seed: int) -> Iterator[bytes]:
    """Endless: the mutants of a target's seeds, some of them mutants of mutants."""
    r = Random(seed)
    pool = list(target.seeds())
    others = tuple(pool)
    while True:
        parent = r.choice(others if r.random() < 0.7 else pool)
        data = _tree_changed(parent, r, others) if target.is_json and r.random() < 0.5 else None
        if data is None:
            data = mutate(parent, r, others=others)
        if r.random() < 0.05 and len(data) < 20_000:
            pool.append(data)
        if len(pool) > 500:
            del pool[len(others) :]
        yield data


def _tree_changed(data: bytes, r: Random, others: tuple[bytes, ...]) -> bytes | None:
    """One to three changes of the JSON tree; None where it is no JSON object any more."""
    try:
        tree = json.loads(data)
        if not isinstance(tree, dict):
            return None
        for _ in range(r.choice((1, 1, 2, 3))):
            seed = r.randrange(2**32)
            tree = mutate_tree(tree, seed, other=json.loads(r.choice(others)))
        ascii_only = r.random() < 0.5
        return json.dumps(tree, ensure_ascii=ascii_only).encode("utf-8", "surrogatepass")
    except (ValueError, RecursionError, IndexError, TypeError):
        return None


def as_text(data: bytes) -> str:
    return json.dumps(data.decode("latin-1"))[:300]
