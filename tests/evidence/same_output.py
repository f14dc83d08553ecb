"""The files that the command line writes, recorded for many problems: what a rebuilding of the code may not change.

    python tests/evidence/same_output.py record FOLDER [--package CHECKOUT] [--only TEXT]
    python tests/evidence/same_output.py compare FOLDER FOLDER

``record`` runs one command after the other as processes, each in a folder of its own, and keeps everything: the exit
code, both outputs, and every file that was written.  ``compare`` names what differs and ends with 1 if anything does.
Nothing of the package is imported here, so that one script serves two versions of it.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]
BUILT_IN = ("clock-sync", "karate-club", "microgrid-ieee14", "paper-fixed", "paper-switching", "uav-swarm")
_COUPLINGS = (
    "y; 2*y; y/3; tanh(y); exp(y) - 1 + y; y + y**3; sin(y); atan(y)/2; sinh(y); y**3; y - y**2; "
    "sin(pi*y); exp(1)*(exp(y) - 1); log(1 + y*pi); abs(y); clip(y, -1, 1); max(y, 2*y); cos(y) - 1 + y; "
    "y/sqrt(1 + y**2); -y/8; tan(y/4); min(y, 2*y); y*exp(-y**2) + y/5; cosh(y) - 1 + y; pi*y/2"
)
SCALAR = tuple(_COUPLINGS.split("; "))
PLANE = (["y1 + y2/2", "y2 - y1/2"], ["sin(y1) + y2**2", "3*y2"], ["y1 - y2/4", "tanh(y2) + sin(pi*y1)/5"])
SINGLE = (
    ([[0]], [[1]], [[2]]),
    ([[0, 2], [-2, 0]], [[1, 0]], [["16/5"], ["12/5"]]),
    ([[0, 1], [0, 0]], [[1, 0]], [[3], [2]]),
    ([[0]], [[0]], None),
    ([[0, 1], [-4, 0]], [[1, 0]], [[-1], [0]]),
    ([["1/10"]], [[1]], None),
)


def toml(value: object) -> str:
    """A value as TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def text_of(tables: dict[str, dict[str, object]]) -> str:
    """A problem file: the table "" first, then the others; a list of tables is an array of tables."""
    lines = []
    for name, keys in tables.items():
        lines.append(f"[{name}]" if name and not name.startswith("[") else name)
        lines += [f"{key} = {toml(value)}" for key, value in keys.items()]
    return "\n".join(lines) + "\n"


def arcs_of(r: Random, n: int) -> list[list[object]]:
    """Arcs [i, j] of one mode: a ring, a chain, a star, or at random; some with weights."""
    kind = r.choice(("ring", "chain", "star", "random", "random", "both"))
    if kind == "ring":
        pairs = [(i, i % n + 1) for i in range(1, n + 1)]
    elif kind == "chain":
        pairs = [(i, i - 1) for i in range(2, n + 1)]
    elif kind == "star":
        pairs = [(i, 1) for i in range(2, n + 1)]
    elif kind == "both":
        pairs = [(i, i % n + 1) for i in range(1, n + 1)] + [(i % n + 1, i) for i in range(1, n + 1)]
    else:
        pairs = [(i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j and r.random() < 0.45]
    unique = sorted({pair for pair in pairs if pair[0] != pair[1]})
    return [[i, j] if r.random() < 0.7 else [i, j, r.choice(("1/2", 2, 3.2, "7/5"))] for i, j in unique]


def random_text(seed: int) -> str:
    """A random problem of nearly every kind that a file can state."""
    r = Random(seed)
    m = r.choice((1, 1, 1, 1, 2))
    n = r.choice((1, 2, 2, 3, 3, 4, 5, 6, 8))
    h: object = r.choice(SCALAR)
    if m == 2 and r.random() < 0.5:
        h = r.choice(PLANE)
    tables: dict[str, dict[str, object]] = {
        "": {"name": f"random-{seed}", "target": r.choice((0, 1, "1/2", -2)) if m == 1 else [0, 1]},
        "network": {"agents": n, "arrow": r.choice(("listens_to", "sends_to"))},
        "network.modes": {f"G{k}": arcs_of(r, n) for k in range(r.choice((1, 1, 1, 2, 3)))},
        "coupling": {"h": h},
    }
    every = sorted({(arc[0], arc[1]) for arcs in tables["network.modes"].values() for arc in arcs})  # type: ignore
    if every and r.random() < 0.25:
        chosen = r.sample(every, min(len(every), 2))
        tables["[[coupling.exceptions]]"] = {"arcs": [list(arc) for arc in chosen], "h": r.choice(SCALAR)}
    how = r.random()
    if how < 0.25:
        tables["pinning"] = {"gains": r.choice((1, 3, "9/16", 5))}
    elif how < 0.9:
        gain = (5, "1/2", 3, 1.5) if m == 1 or r.random() < 0.6 else ([[2, 0], [0, "3/2"]], [[1, 1], [-1, 1]])
        tables["pinning"] = {"gains": {i: r.choice(gain) for i in r.sample(range(1, n + 1), r.choice((1, min(2, n))))}}
    asked = r.random() < 0.75
    given = r.random() < 0.7
    if given:
        if m == 1:
            A, C, W = r.choice(SINGLE)
        else:
            A, C, W = r.choice((([[0]], [[1], [1]], None), ([[0, 1], [-1, 0]], [[1, 0], [0, 1]], [[1, 0], [0, 1]])))
        tables["exosystem"] = {"A": A, "C": C}
        if W is not None and r.random() < 0.7:
            tables["observer"] = {"W": W}
            if A == [[0, 2], [-2, 0]] and r.random() < 0.5:
                tables["observer"]["P"] = [["1/2", "-1/4"], ["-1/4", "1/3"]]
        if n >= 3 and m == 1 and r.random() < 0.2:
            tables["[[exosystem.groups]]"] = {"agents": [2, 3], "A": [[0]], "C": [[1]], "W": [[3]]}
            tables.get("observer", {}).pop("P", None)
    if asked:
        tables["region"] = {"initial_states": r.choice(([0, 5], [-1, 1], ["1/4", 2], [-3, 3], [-0.5, 0.5]))}
        if given:
            tables["region"]["initial_disturbance"] = r.choice((0, 0.1, 0.5))
    if r.random() < 0.15:
        tables["formation"] = {"offsets": {1: 1.5 if m == 1 else [1, -1]}}
    return text_of(tables)


def fixed_text(name: str, arcs: list[list[int]], h: str, gains: object, starts: list[int], *, observed: bool) -> str:
    """Agents on these arcs with a region; ``observed``: a disturbance too, and the target 1."""
    tables: dict[str, dict[str, object]] = {
        "": {"name": name, "target": 1} if observed else {"name": name},
        "network": {"agents": len(arcs), "arrow": "listens_to"},
        "network.modes": {"ring" if observed else "a": arcs},
        "coupling": {"h": h},
        "pinning": {"gains": gains},
    }
    if observed:
        tables["exosystem"] = {"A": [[0, 2], [-2, 0]], "C": [[1, 0]]}
    tables["region"] = {"initial_states": starts} | ({"initial_disturbance": 0.1} if observed else {})
    return text_of(tables)


def ring_text(n: int, h: str, *, every: int) -> str:
    """A large ring with a pin at every so many agents."""
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    return fixed_text(f"ring-{n}", arcs, h, dict.fromkeys(range(1, n + 1, every), 3), [0, 2], observed=True)


def problems() -> dict[str, str]:
    """All problem files by name."""
    return {f"random-{seed}": random_text(seed) for seed in range(1, 71)} | {
        "ring-300": ring_text(300, "tanh(y)", every=3),
        "ring-2500": ring_text(2500, "exp(y) - 1 + y", every=5),
        "ring-150-sin": ring_text(150, "sin(y)", every=1),
        "equilibrium": fixed_text("equilibrium", [[1, 2], [2, 1]], "sin(y)", {1: "1/10"}, [-5, 5], observed=False),
        "boxes": fixed_text("boxes", [[1, 2], [2, 1]], "exp(y) - 1 + y", 3, [-3, 3], observed=False),
    }


def commands() -> dict[str, tuple[str | None, list[str]]]:
    """Name -> (problem file to write beside it or None, arguments of dobc)."""
    lines: dict[str, tuple[str | None, str]] = {}
    for name in BUILT_IN:
        lines[f"certify {name}"] = (None, f"certify {name} --out out --json")
        lines[f"check {name}"] = (None, f"check {name} --canonical problem.json")
        lines[f"simulate {name}"] = (None, f"simulate {name} --t-final 4 --json")
    texts = problems()
    for name, text in texts.items():
        more = " --all" if name in ("boxes", "random-3", "random-8", "random-21", "random-30", "random-41") else ""
        more += " --settling 1/100" if name in ("random-5", "random-12", "random-14", "boxes") else ""
        lines[f"certify {name}"] = (text, f"certify {name}.toml --out out --json{more}")
    for name in (f"random-{seed}" for seed in (2, 9, 16, 23, 33, 44)):
        lines[f"certify-text {name}"] = (texts[name], f"certify {name}.toml --apply-fix cured.toml --out out")
        lines[f"region {name}"] = (texts[name], f"region {name}.toml --out out --json")
        lines[f"design {name}"] = (texts[name], f"design {name}.toml --out new.toml --json")
        lines[f"export {name}"] = (texts[name], f"export {name}.toml --sdpa lmi.dat-s --json")
    for name in ("clock-sync", "paper-fixed", "paper-switching"):
        lines[f"region {name}"] = (None, f"region {name} --out out")
        lines[f"certify-text {name}"] = (None, f"certify {name} --out out --search")
        lines[f"design {name}"] = (None, f"design {name} --out new.toml --json")
        lines[f"settling {name}"] = (None, f"certify {name} --settling 1/100 --out out --json")
        lines[f"export {name}"] = (None, f"export {name} --python-control loop.py --json")
        lines[f"c {name}"] = (None, f"export {name} --c code --period 1/100 --json")
        lines[f"stress {name}"] = (None, f"simulate {name} --runs 4 --t-final 3 --noise 0.01 --json --out runs")
        lines[f"sampled {name}"] = (None, f"simulate {name} --period 0.02 --t-final 3 --json")
    lines["breaks"] = (None, "simulate clock-sync --what-breaks-first --t-final 5 --json")
    lines["sweep"] = (None, "sweep paper-fixed pinning.gains.1=1:5:3 --out sweep --jobs 1 --json")
    lines |= {"problems": (None, "problems --json"), "schema": (None, "schema"), "help": (None, "--help")}
    for name in ("certify", "simulate", "design", "export", "sweep", "report"):
        lines[f"help {name}"] = (None, f"{name} --help")
    for name in ("theorem1", "lure", "max-separable", "hurwitz"):
        lines[f"explain {name}"] = (None, f"explain {name}")
    return {name: (text, line.split()) for name, (text, line) in lines.items()}


def record(folder: Path, package: Path, only: str) -> None:
    """Run every command and keep what it gives."""
    chosen = {name: what for name, what in commands().items() if re.search(only, name)}
    environment = dict(os.environ, PYTHONPATH=str(package), OPENBLAS_NUM_THREADS="1", COLUMNS="120", NO_COLOR="1")
    done = 0

    def run(name: str) -> None:
        nonlocal done
        text, arguments = chosen[name]
        place = folder / name.replace(" ", "_")
        place.mkdir(parents=True)
        if text is not None:
            (place / next(word for word in arguments if word.endswith(".toml"))).write_text(text, encoding="utf-8")
        program = [sys.executable, "-m", "dobc_design"]
        how = {"cwd": place, "env": environment, "capture_output": True, "timeout": 600, "stdin": subprocess.DEVNULL}
        try:
            ended = subprocess.run([*program, *arguments], check=False, **how)
            (place / "exit-code").write_text(f"{ended.returncode}\n", encoding="utf-8")
            (place / "standard-output").write_bytes(ended.stdout)
            (place / "standard-error").write_bytes(re.sub(rb"\d+\.\d+ s\b", b"# s", ended.stderr))
        except subprocess.TimeoutExpired:
            (place / "exit-code").write_text("more than 600 s\n", encoding="utf-8")
        if (place / "out" / "certificate.json").exists():
            ended = subprocess.run([*program, *["verify", "out", "--problem", "out/problem.json"]], check=False, **how)
            (place / "verified").write_bytes(b"%d\n" % ended.returncode + ended.stdout)
        done += 1
        sys.stderr.write(f"\r{done} of {len(chosen)}  {name:40}")

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(run, chosen))
    sys.stderr.write("\n")


def without_modules(path: Path) -> bytes:
    """What stands in a file, without the names of the modules that the table of a report gives."""
    text = path.read_bytes()
    if path.suffix == ".md":
        return re.sub(rb"[a-z_/\\]+\.py(, [a-z_/\\]+\.py)*", b"MODULES", text)
    return text


def compare(before: Path, after: Path) -> int:
    """How many files differ, each named; pages are not compared, for their text stands in the .md beside them."""
    names = {path.relative_to(folder) for folder in (before, after) for path in folder.rglob("*") if path.is_file()}
    names = {name for name in names if name.suffix not in (".html", ".npz", ".pdf", ".svg")}
    ran = {path.name for path in after.iterdir()}

    def same(name: Path) -> bool:
        old, new = before / name, after / name
        return old.exists() and new.exists() and without_modules(old) == without_modules(new)

    wrong = [str(name) for name in sorted(names) if name.parts[0] in ran and not same(name)]
    sys.stdout.write("".join(f"differs: {name}\n" for name in wrong))
    sys.stdout.write(f"{len(names)} files of {len(ran)} commands, {len(wrong)} differ\n")
    return len(wrong)


def main() -> None:
    """Read the command line."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("what", choices=("record", "compare"))
    reader.add_argument("folders", nargs="+", type=Path)
    reader.add_argument("--package", type=Path, default=ROOT)
    reader.add_argument("--only", default="")
    given = reader.parse_args()
    if given.what == "record":
        record(given.folders[0].resolve(), given.package.resolve(), given.only)
    else:
        sys.exit(compare(given.folders[0], given.folders[1]) > 0)


if __name__ == "__main__":
    main()
