"""The pages of the handbook as the theme writes them: controls have names once
``docs/_ext/accessible.py`` ran."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="needs the extra `docs`: pip install 'dobc_design[docs]'")
pytest.importorskip(
    "pydata_sphinx_theme", reason="needs the extra `docs`: pip install 'dobc_design[docs]'"
)

pytestmark = pytest.mark.slow
EXTENSIONS = Path(__file__).parents[1] / "docs" / "_ext"
PAGES = {
    "index": ".. toctree::\n\n   a/one\n",
    "a/one": ".. toctree::\n\n   two\n",
    "a/two": "Text.\n",
}


@pytest.mark.parametrize("extension", [True, False])
def test_the_search_button_and_the_toggles_of_the_navigation_have_names(
    tmp_path: Path, extension: bool
):
    (tmp_path / "a").mkdir()
    for name, text in PAGES.items():
        (tmp_path / f"{name}.rst").write_text(f"Title\n=====\n\n{text}", "utf-8")
    names = '["accessible"]' if extension else "[]"
    settings = (
        f"import sys; sys.path.insert(0, {str(EXTENSIONS)!r})\nhtml_theme = 'pydata_sphinx_theme'\n"
    )
    (tmp_path / "conf.py").write_text(f"{settings}extensions = {names}\n", "utf-8")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-b",
        "html",
        str(tmp_path),
        str(tmp_path / "out"),
    ]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    page = (tmp_path / "out" / "a" / "two.html").read_text("utf-8")
    nameless = re.findall(r'<summary><span class="toctree-toggle"', page)
    wrong = re.findall(r'<button[^>]*search-button__button[^>]*aria-label="Search"', page)
    assert (nameless == [] and wrong == []) is extension
