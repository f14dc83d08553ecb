"""Labels with accents on the command line name the same agent in either form of Unicode (NFC,
NFD)."""

from pathlib import Path
from unicodedata import normalize

import pytest

from dobc_design.export import fmu

STAR = """\
[network]
agents = ["chef-d'équipe", "élève"]
arrow = "listens_to"
modes.G = [["élève", "chef-d'équipe"]]
[coupling]
h = "y"
[pinning]
gains = { "chef-d'équipe" = 2, "élève" = 1 }
"""
OPTIONS = {
    "design": ["design", "star.toml", "--out", "new.toml", "--allowed", "chef-d'équipe"],
    "agent fails": ["stress", "star.toml", "--t-final", "2", "--fail", "élève@1"],
    "C code": ["export", "star.toml", "--c", "code", "--period", "1/20", "--agent", "élève"],
    "FMU": ["export", "star.toml", "--fmu", "agent.fmu", "--period", "1/20", "--agent", "élève"],
    "sweep": ["sweep", "star.toml", 'pinning.gains."élève"=1,2', "--out", "cases", "--jobs", "1"],
}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("forms", [("NFC", "NFD"), ("NFD", "NFC")])
@pytest.mark.parametrize("name", OPTIONS)
def test_an_accent_in_another_form_names_the_same_agent(
    name: str, forms: tuple[str, str], command_line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(fmu, "COMPILERS", ())  # what is compiled makes no difference
    within, typed = forms
    (tmp_path / "star.toml").write_text(normalize(within, STAR), encoding="utf-8")
    code, out, err = command_line(*(normalize(typed, text) for text in OPTIONS[name]), "--json")
    assert code == 0, err
    if name != "FMU":  # its document names no agents
        label = "chef-d'équipe" if name == "design" else "élève"
        assert normalize("NFC", label) in normalize("NFC", out)
