"""What Coq's kernel says of a file: accepted or not, the theorem, what it assumes.  Nothing here
decides anything."""

import hashlib
import re
import resource
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from dobc_design._checks import noun
from dobc_design.conditions.numbers import fields_to_json
from dobc_design.errors import SolverError, refused

THEOREM = "every_motion_converges"
FILE = "proof.v"
MINUTES, GIBIBYTES = 30, 8  # after which, and beyond which, coqc is ended
CURE = "On Debian or Ubuntu: apt install coq libcoq-coquelicot libcoq-interval."


@noun
class Judgement:
    """``accepted``: coqc ended without an error.  ``axioms``: what the theorem assumes, as Coq
    prints it; ``message``: what it said against the file; ``sha256`` of the file; ``coq``: its
    version."""

    accepted: bool
    coq: str
    sha256: str
    axioms: tuple[str, ...] = ()
    message: str = ""

    def __str__(self) -> str:
        if not self.accepted:
            return f"Coq {self.coq} does not accept the proof: {self.message}"
        listed = ", ".join(self.axioms)
        told = (
            f"Coq {self.coq} accepts the theorem {THEOREM} of the file with SHA-256 {self.sha256}."
        )
        return f"{told} It assumes: {listed}."

    def to_json(self) -> dict[str, Any]:
        shown = fields_to_json(self, "accepted", "coq", "sha256", "message", "axioms")
        return {"theorem": THEOREM, **shown}


def judged(text: str) -> Judgement:
    """Run coqc on the text of a file.  Raises: SpecError where Coq or one of its libraries is
    missing, SolverError where it does not end in time or the machine fails."""
    coqc = shutil.which("coqc")
    if coqc is None:
        raise refused("--rocq", "coqc is not installed.", CURE)
    asked = subprocess.run([coqc, "--print-version"], capture_output=True, text=True, check=False)
    version = asked.stdout.split()
    # A proof that needs more would take the machine with it.
    most = GIBIBYTES * 2**30
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / FILE
        path.write_text(text, "ascii")
        try:
            done = subprocess.run(
                [coqc, "-q", str(path)],
                capture_output=True,
                text=True,
                check=False,
                timeout=60 * MINUTES,
                preexec_fn=partial(resource.setrlimit, resource.RLIMIT_AS, (most, most)),
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SolverError(
                f"coqc did not end within {MINUTES} minutes, or could not run: {error}"
            ) from error
    if "Cannot find a physical path" in done.stderr or "Unable to locate library" in done.stderr:
        raise refused("--rocq", "Coq is installed, but Coquelicot or Interval is not.", CURE)
    # Warnings come before it.
    said = done.stderr.rpartition("Error:")[2].split()
    return Judgement(
        accepted=done.returncode == 0,
        coq=version[0] if version else "",
        sha256=hashlib.sha256(text.encode("ascii")).hexdigest(),
        axioms=tuple(
            re.findall(r"^([A-Za-z_.0-9]+)\s*:", done.stdout.partition("Axioms:")[2], re.MULTILINE)
        ),
        message=" ".join(said[:60]),
    )
