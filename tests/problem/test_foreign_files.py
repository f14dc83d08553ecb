"""Files of other programs, given as a problem or as a certificate, are named as what they are."""

import json

import networkx as nx
import pytest

import dobc_design as dd
from dobc_design.certificate.text import read_claims
from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.canonical import canonical_bytes

GRAPH = nx.DiGraph([("a", "b")])
FOREIGN = {
    "node-link": (
        nx.node_link_data(GRAPH),
        "networkx's node-link form.*node_link_graph.*write_graphml",
    ),
    "adjacency": (nx.adjacency_data(GRAPH), "networkx's adjacency form.*adjacency_graph"),
    "cytoscape": (nx.cytoscape_data(GRAPH), "a graph of Cytoscape.*cytoscape_graph"),
    "package.json": (
        {"name": "x", "version": "1.0.0", "dependencies": {}},
        "package.json of a JavaScript project",
    ),
    "notebook": ({"cells": [], "metadata": {}, "nbformat": 4}, "a Jupyter notebook"),
    "geojson": ({"type": "FeatureCollection", "features": []}, "GeoJSON"),
    "schema": ({"$schema": "http://json-schema.org/draft-07/schema#"}, "a JSON Schema"),
    "toml as json": (
        {"network": {"agents": 2, "arrow": "listens_to"}},
        "a problem file in JSON.*as TOML",
    ),
    "pandapower": ({"_module": "pandapower.auxiliary"}, "a pandapower network.*--from FILE"),
    "run": ({"format": "dobc-trajectory"}, "another file of dobc_design"),
    "list": ([1, 2], "it holds a list"),
    "number": (3, "it holds a single value"),
    "unknown": ({"a": 1, "b\x1b": 2}, r'no "format" of dobc_design; its keys are a, b\\x1b'),
    "empty": ({}, "its keys are none"),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_it_is_named_where_a_problem_or_a_certificate_is_wanted(kind, tmp_path):
    document, said = FOREIGN[kind]
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(document))
    with pytest.raises(SpecError, match=f"mine.json is not a problem.*{said}") as caught:
        dd.load_problem(path)
    assert caught.value.cure
    with pytest.raises(CertificateError, match=f"the file is not a certificate.*{said}"):
        read_claims(path.read_bytes())


def test_a_certificate_given_as_a_problem_and_the_other_way_round(tmp_path):
    problem = dd.load_problem("clock-sync")
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps({"format": "dobc-certificate", "version": 1}))
    with pytest.raises(
        SpecError,
        match=r"certificate.json is not a problem but a certificate.*problem.json beside it",
    ):
        dd.load_problem(path)
    with pytest.raises(CertificateError, match="is not a certificate but a problem of dobc_design"):
        dd.verify(canonical_bytes(problem), problem)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "net.csv",
            "'net.csv' is a file of arcs, not a problem file.*--from FILE --arrow listens_to",
        ),
        ("net.graphml", "is a file of arcs"),
        (
            "case9.m",
            "'case9.m' is a MATPOWER case, not a problem file.*`dobc new NAME --from FILE` makes",
        ),
    ],
)
def test_a_network_given_as_a_problem_file_says_how_it_becomes_one(name, said, tmp_path):
    (tmp_path / name).write_text("a,b\n")
    with pytest.raises(SpecError, match=said):
        dd.load_problem(tmp_path / name)
    (tmp_path / "mine.txt").write_text("a,b\n")  # which may be a problem file
    with pytest.raises(SpecError, match="not valid TOML"):
        dd.load_problem(tmp_path / "mine.txt")
