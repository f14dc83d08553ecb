"""The handbook: `make docs` builds docs/_build/html, offline and without a warning."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from dobc_design import __version__

project = "dobc_design"
author = "dobc_design contributors"
copyright = author
release = version = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "docstrings",
    "gallery",
    "generated",
    "mathml",
    "names",
]
exclude_patterns = ["_build", "_ext"]
# notebooks show figures in richer ways as well
suppress_warnings = ["mystnb.unknown_mime_type"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # _ext/executed.py runs them, several at a time
nb_merge_streams = True

autodoc_typehints = "none"  # the docstrings say shapes and units, which types cannot
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
add_module_names = False
nitpicky = False

html_theme = "pydata_sphinx_theme"
html_title = f"dobc_design {release}"
html_static_path = ["_static"]
html_css_files = ["handbook.css"]
html_show_sourcelink = False
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
extensions += ["accessible"]  # last: it names controls in the pages that were written
