"""Files that come with the package: tables, templates, theories."""

import tomllib
from importlib.resources import files
from typing import Any


def own_text(path: str) -> str:
    """The text of one, by its path in the package."""
    return (files("dobc_design") / path).read_text("utf-8")


def own_table(path: str) -> Any:
    """A TOML file among them."""
    return tomllib.loads(own_text(path))
