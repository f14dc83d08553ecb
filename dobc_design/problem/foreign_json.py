"""JSON that is no problem: what it is, by the keys that its program writes, and what to do with
it."""

from collections.abc import Mapping
from typing import Any

from dobc_design.errors import SpecError, refused
from dobc_design.exact.reading import named

_TO_FILE = "with networkx.write_graphml(graph, file), which `dobc new NAME --from FILE` reads."
_ONLY = ""  # the cure that says what is wanted instead
PROBLEM, CERTIFICATE = "a problem", "a certificate"
_WANTED = {
    PROBLEM: "A problem is a .toml file, or the problem.json that dobc_design writes.",
    CERTIFICATE: "A certificate is the certificate.json that `dobc certify` writes.",
}

#: What it is, the keys by which it is known, and the cure.  The first that fits counts.
_KINDS = (
    (
        "a certificate of dobc_design",
        lambda found: found.get("format") == "dobc-certificate",
        "Its problem is the problem.json beside it; `dobc verify CERT --problem FILE` and `dobc "
        "report CERT` take it.",
    ),
    (
        "a problem of dobc_design",
        lambda found: found.get("format") == "dobc-problem",
        "Its certificate is the certificate.json beside it; `dobc certify FILE` makes one.",
    ),
    (
        "another file of dobc_design",
        lambda found: str(found.get("format", "")).startswith("dobc-"),
        _ONLY,
    ),
    (
        "a pandapower network",
        lambda found: "pandapower" in str(found.get("_module", "")),
        "`dobc new NAME --from FILE` makes a problem of it.",
    ),
    (
        "a graph in networkx's node-link form (also of D3)",
        lambda found: "nodes" in found and ("links" in found or "edges" in found),
        f"graph = networkx.node_link_graph(json.load(file)) reads it; write it {_TO_FILE}",
    ),
    (
        "a graph in networkx's adjacency form",
        lambda found: "nodes" in found and "adjacency" in found,
        f"graph = networkx.adjacency_graph(json.load(file)) reads it; write it {_TO_FILE}",
    ),
    (
        "a graph of Cytoscape",
        lambda found: isinstance(found.get("elements"), Mapping) and "nodes" in found["elements"],
        f"graph = networkx.cytoscape_graph(json.load(file)) reads it; write it {_TO_FILE}",
    ),
    ("a Jupyter notebook", lambda found: "cells" in found and "nbformat" in found, _ONLY),
    (
        "the package.json of a JavaScript project",
        lambda found: (
            "version" in found
            and bool({"dependencies", "devDependencies", "scripts", "main"} & set(found))
        ),
        _ONLY,
    ),
    (
        "GeoJSON",
        lambda found: found.get("type") in ("FeatureCollection", "Feature", "GeometryCollection"),
        _ONLY,
    ),
    ("a JSON Schema", lambda found: "$schema" in found or "$defs" in found, _ONLY),
    (
        "a problem file in JSON",
        lambda found: (
            isinstance(found.get("network"), Mapping)
            and bool({"agents", "modes"} & set(found["network"]))
        ),
        "Write it as TOML: [network], below it agents = ... and arrow = ...; `dobc new NAME` "
        "writes an example.",
    ),
)


def not_a(wanted: str, document: Any, *, name: str) -> SpecError:
    """The error that ``document``, read of the file ``name``, is not ``wanted``, and what it is."""
    only = _WANTED[wanted]
    if not isinstance(document, Mapping):
        kind = "a list" if isinstance(document, list) else "a single value"
        return refused("format", f"{named(name)} is not {wanted}: it holds {kind}.", only)
    for what, fits, cure in _KINDS:
        if fits(document):
            return refused("format", f"{named(name)} is not {wanted} but {what}.", cure or only)
    keys = ", ".join(named(str(key)) for key in list(document)[:4]) or "none"
    what = f'{named(name)} is not {wanted}: it has no "format" of dobc_design; its keys are {keys}'
    return refused("format", f"{what}{', ...' if len(document) > 4 else ''}.", only)
