"""The picture of the README and of the handbook's first page.

``python docs/_ext/overview.py`` writes docs/_static/mine.svg anew; a test holds it against what
this file draws.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import dobc_design as dd
from dobc_design._show.text import lower
from dobc_design.plotting import look, networks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOCS = Path(__file__).resolve().parents[1]
PICTURE = DOCS / "_static" / "mine.svg"
RUNS, SECONDS, MOST_POINTS = 20, 8, 60


def mine() -> str:
    """The problem file that the README shows."""
    readme = (DOCS.parent / "README.md").read_text("utf-8")
    return re.search(r"^```toml\n(# mine\.toml\n.*?)^```$", readme, re.MULTILINE | re.DOTALL)[1]


def overview() -> look.Sheet:
    """The network of mine.toml, and simulated runs below the certified bound."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.toml"
        path.write_text(mine(), "utf-8")
        problem = dd.load_problem(str(path))
    certificate = dd.certify(problem)
    runs = dd.simulate(problem, runs=RUNS, t_final=SECONDS)
    bound = certificate.envelope(runs)(runs.times)
    (mode,) = problem.network.modes.values()
    pairs = {(listener, speaker): weight for listener, speaker, weight in mode}

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=[1, 2])
        places = networks.positions(pairs, problem.n)
        settings: dict[str, Any] = {
            "labels": problem.network.labels,
            "pinned": problem.pinning.agents,
        }
        networks.draw_network(left, arcs=pairs, places=places, **settings)
        left.set_title("squares know the target")
        rows = look.thinned_rows(len(runs.times), MOST_POINTS)
        for error in runs.error:
            right.plot(runs.times[rows], error[rows], color=look.MUTED, linewidth=0.6, alpha=0.7)
        right.lines[0].set_label(f"{RUNS} simulated runs")
        right.plot(
            runs.times[rows], bound[rows], color=look.BLUE, linewidth=2, label="certified bound"
        )
        right.set(
            xlabel="time in s", xlim=(0, SECONDS), ylim=(0, None), ylabel="largest error in m/s"
        )
        right.set_title(
            f"{certificate.verdict.value}: decay rate at least {lower(certificate.rate)} 1/s"
        )
        right.legend(loc="upper right")

    return look.Sheet(draw, width=8.6, height=2.8)


if __name__ == "__main__":
    overview().save(PICTURE)
