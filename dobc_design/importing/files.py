"""A problem from a file of another program, by the suffix of its name."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.importing.grids import grid_problem, is_pandapower, read_matpower, read_pandapower
from dobc_design.problem.arcs_file import READERS, labels_in_file, read_arcs_file
from dobc_design.problem.load import load_problem, read_bytes
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem, is_name

LARGEST = 256 * 1024 * 1024
SUFFIXES = (".m", ".json", *READERS, ".toml")
ARCS_ONLY = (
    "Imported from {file}, which holds arcs and nothing else.",
    'Stand-ins: the coupling h = "y" is linear, nobody is pinned, and there is no disturbance. Fill them in.',
)


def problem_from_file(path: str | PathLike[str], *, arrow: str | None = None) -> Problem:
    """Make a problem from a file of another program, by its suffix.

    .m MATPOWER case; .json pandapower network (or problem.json); .csv, .graphml, .edges arcs, for which
    ``arrow`` ("listens_to" or "sends_to") has to say what a pair means; .toml a problem file.
    Returns: a Problem whose notes say what was assumed.  Raises: SpecError.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        what = f"{shown(path.name)} must end in one of {', '.join(SUFFIXES)}, which say what kind of file it is."
        raise SpecError(what, key=path.name, cure="Rename or convert it.")
    if arrow is not None and suffix not in READERS:
        what = f"arrow is for files of arcs ({', '.join(READERS)}); {shown(path.name)} says itself who listens."
        raise SpecError(what, key="--arrow", cure="Leave it out.")
    name = path.stem if is_name(path.stem) else "problem"
    if suffix in READERS:
        if arrow is None:
            why = "there is no default, because a wrong guess is never noticed."
            cure = "listens_to: a hears b.  sends_to: a is heard by b."
            raise SpecError(f"arrow must say what a pair a, b of the file means; {why}", key="--arrow", cure=cure)
        folder = path.resolve().parent
        labels = labels_in_file(path.name, folder=folder, key="arcs")
        index = {label: place for place, label in enumerate(labels)}
        arcs = read_arcs_file(path.name, folder=folder, index=index, arrow=arrow, key="arcs")
        notes = [note.format(file=path.name) for note in ARCS_ONLY]
        return Problem(name=name, network=Network(labels=labels, modes={"G": arcs}), coupling="y", notes=notes)
    if suffix == ".toml":
        return load_problem(path)
    data = read_bytes(path, limit=LARGEST, what="file")
    if suffix == ".m":
        return grid_problem(read_matpower(data.decode("utf-8", errors="replace"), name=path.name), name=name)
    if is_pandapower(data):
        return grid_problem(read_pandapower(data, name=path.name), name=name)
    return load_problem(path)
