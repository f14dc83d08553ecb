"""Files of other programs, given as a problem or as a certificate, are named as what they are."""

import json

import networkx as nx
import pytest

import dobc_design as dd
from dobc_design.certificate.text import read_claims
from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.canonical import canonical_bytes

GRAPH = nx.DiGraph([("a", "b")])
FOREIGN = []


def foreign(kind: str, said: str, document: object) -> None:
    FOREIGN.append(pytest.param(document, said, id=kind))


NODE_LINK = "networkx's node-link form.*node_link_graph.*write_graphml"
foreign("node-link", NODE_LINK, nx.node_link_data(GRAPH))
foreign("adjacency", "networkx's adjacency form.*adjacency_graph", nx.adjacency_data(GRAPH))
foreign("cytoscape", "a graph of Cytoscape.*cytoscape_graph", nx.cytoscape_data(GRAPH))
PACKAGE = {"name": "x", "version": "1.0.0", "dependencies": {}}
foreign("package.json", "package.json of a JavaScript project", PACKAGE)
foreign("notebook", "a Jupyter notebook", {"cells": [], "metadata": {}, "nbformat": 4})
foreign("geojson", "GeoJSON", {"type": "FeatureCollection", "features": []})
foreign("schema", "a JSON Schema", {"$schema": "http://json-schema.org/draft-07/schema#"})
AS_JSON = {"network": {"agents": 2, "arrow": "listens_to"}}
foreign("toml as json", "a problem file in JSON.*as TOML", AS_JSON)
foreign("pandapower", "a pandapower network.*--from FILE", {"_module": "pandapower.auxiliary"})
foreign("run", "another file of dobc_design", {"format": "dobc-trajectory"})
foreign("list", "it holds a list", [1, 2])
foreign("number", "it holds a single value", 3)
UNKNOWN = r'no "format" of dobc_design; its keys are a, b\\x1b'
foreign("unknown", UNKNOWN, {"a": 1, "b\x1b": 2})
foreign("empty", "its keys are none", {})


@pytest.mark.parametrize(("document", "said"), FOREIGN)
def test_it_is_named_where_a_problem_or_a_certificate_is_wanted(document, said, tmp_path):
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
