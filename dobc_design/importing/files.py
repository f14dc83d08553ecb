"""A problem from a file of another program, by the suffix of its name."""

from os import PathLike
from pathlib import Path

import numpy as np

from dobc_design.errors import refused
from dobc_design.exact.reading import shown
from dobc_design.problem.arcs_file import EDGES, READERS, TABLES, read_arcs_file
from dobc_design.problem.load import load_problem, read_bytes
from dobc_design.problem.network import Arcs, Network
from dobc_design.problem.problem import Problem, is_name

from .grids import grid_problem, is_pandapower, read_matpower, read_pandapower

LARGEST = 256 * 1024 * 1024
SUFFIXES = (".m", ".json", *READERS, ".toml")
ARCS_ONLY = (
    "Imported from {file}, which holds arcs and nothing else.",
    'Stand-ins: the coupling h = "y" is linear, nobody is pinned, and there is no '
    "disturbance. Fill them in.",
)
ONE_WAY = (
    "Every line of {file} is one arc, and no two agents hear each other. If its edges have "
    "no direction, add a header"
    " with a column type and write Undirected there, or list each edge both ways."
)
UNWEIGHTED = (
    "Every arc has the weight 1: no edge of {file} has an attribute called weight, w or "
    "value with another number. If"
    " another attribute is meant, call it weight."
)


def problem_from_file(
    path: str | PathLike[str],
    *,
    arrow: str | None = None,
    merge: str | None = None,
    drop_loops: bool = False,
    negative: str | None = None,
) -> Problem:
    """Make a problem from a file of another program, by its suffix.

    .m MATPOWER case; .json pandapower network (or problem.json); .csv, .edges, .graphml, .gml, .net
    (Pajek), .mtx (Matrix Market) arcs, for which ``arrow`` ("listens_to" or "sends_to") has to say
    what a pair means; .toml a problem file.  Of arcs ``merge`` "sum" adds the weights of parallel
    ones, ``drop_loops`` leaves out those from an agent to itself; ``negative`` says what negative
    weights mean: "opposes", the listener follows -x of the speaker, or "repels", it moves away.
    Returns: a Problem whose notes say what was assumed.  Raises: SpecError.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        what = f"{shown(path.name)} must end in one of {', '.join(SUFFIXES)}, which say what kind "
        raise refused(path.name, f"{what}of file it is.", "Rename or convert it.")
    given = {
        "arrow": arrow is not None,
        "merge": merge is not None,
        "drop_loops": drop_loops,
        "negative": negative is not None,
    }
    for option, is_given in given.items():
        if is_given and suffix not in READERS:
            what = f"{option} is for files of arcs ({', '.join(READERS)}); {shown(path.name)} says "
            key = f"--{option.replace('_', '-')}"
            raise refused(key, f"{what}itself who listens.", "Leave it out.")
    name = path.stem if is_name(path.stem) else "problem"
    if suffix in READERS:
        if arrow is None:
            what = "arrow must say what a pair a, b of the file means; there is no default, "
            what += "because a wrong guess is never noticed."
            raise refused("--arrow", what, "listens_to: a hears b.  sends_to: a is heard by b.")
        labels, arcs = read_arcs_file(
            path.name,
            folder=path.resolve().parent,
            arrow=arrow,
            key="arcs",
            merge=merge,
            drop_loops=drop_loops,
        )
        network = Network(labels=labels, modes={"G": arcs}, negative=negative)
        return Problem(name=name, network=network, coupling="y", notes=_notes(path, arcs))
    if suffix == ".toml":
        return load_problem(path)
    # JSON may be of pandapower or a problem.json: its contents tell.
    data = read_bytes(path, limit=LARGEST, what="file")
    if suffix == ".m":
        text = data.decode("utf-8", errors="replace")
        return grid_problem(read_matpower(text, path.name), name=name)
    if is_pandapower(data):
        return grid_problem(read_pandapower(data, path.name), name=name)
    return load_problem(path)


def _notes(path: Path, arcs: Arcs) -> list[str]:
    """What is said of a problem that was a file of arcs."""
    suffix = path.suffix.lower()
    sentences = list(ARCS_ONLY)
    if suffix in TABLES and _goes_one_way(arcs):
        sentences.append(ONE_WAY)
    if suffix in EDGES and set(arcs.weights) == {1}:
        sentences.append(UNWEIGHTED)
    return [sentence.format(file=path.name) for sentence in sentences]


def _goes_one_way(arcs: Arcs) -> bool:
    """Whether no two agents hear each other, as where a list of undirected edges names each
    once."""
    # Arcs as single numbers, so that millions are compared at once.
    size = int(max(arcs.listeners.max(), arcs.speakers.max())) + 1
    there = arcs.listeners * size + arcs.speakers
    back = arcs.speakers * size + arcs.listeners
    return not np.isin(there, back).any()
