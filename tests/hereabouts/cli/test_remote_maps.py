"""Commands on a map that is published on a SPARQL server."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import rdflib
import rdflib.compare

from kg.model import vocabulary as v


def test_a_published_map_is_read_as_its_folder(kitchen_map, sparql_server, prints, tmp_path):
    places = (kitchen_map, sparql_server)
    prints("publish", kitchen_map, "--to", sparql_server, "--once")
    graphs = []
    for place in places:
        prints("export", place, "--no-ontology", "-o", tmp_path / "out.ttl")
        graph = rdflib.Graph().parse(tmp_path / "out.ttl")
        graph.remove((None, rdflib.URIRef(v.SEQUENCE), None))
        graphs.append(graph)
    assert len(graphs[0]) > 200
    assert rdflib.compare.isomorphic(*graphs)

    here, there = (json.loads(prints("find", place, "cup", "--json")) for place in places)
    assert here["goals"]
    # one is asked some seconds after the other, so that probabilities and ages differ a little
    # the folder alone has the camera poses that showed things, so looks may come in another order
    assert {(g["iri"], g["kind"]) for g in here["goals"]} == {
        (g["iri"], g["kind"]) for g in there["goals"]
    }
    assert here["probability"] == pytest.approx(there["probability"], abs=0.05)
    first, also = here["steps"][0], there["steps"][0]
    assert [first[k] for k in ("x", "y", "heading")] == [also[k] for k in ("x", "y", "heading")]
    here, there = (prints("ask", place, "objects", "--format", "csv") for place in places)
    assert here == there
    assert prints("status", sparql_server, "cup").startswith("cup: ")
    assert prints("check", sparql_server) == ""
    prints("find", sparql_server, "banana", "--picture", tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_a_server_that_is_not_there_is_one_line(fails: Callable[..., str], tmp_path: Path) -> None:
    nowhere = "http://127.0.0.1:9"
    for words in (
        ("ask", nowhere, "objects"),
        ("find", nowhere, "cup"),
        ("export", nowhere, "-o", tmp_path / "x.ttl"),
        ("check", nowhere),
        ("plot", nowhere, "-o", tmp_path / "x.png"),
    ):
        assert "no server answers at http://127.0.0.1:9" in fails(*words)


def test_a_command_that_writes_names_publish_instead(
    kitchen_map, kitchen, sparql_server, shared, fails, prints
):
    prints("publish", kitchen_map, "--to", sparql_server, "--once")
    objects = shared("reference/saved_objects_lab.json")
    for words in (
        ("map", kitchen, "--into", sparql_server),
        ("thesis", "import", "--objects", objects, "--into", sparql_server),
        ("assert", sparql_server, "object/1", "category", "cup"),
        ("update", sparql_server, "-e", "INSERT DATA { <object/1> rdfs:comment 'x' }"),
        ("describe", sparql_server, "--title", "mine"),
        ("compact", sparql_server),
    ):
        assert f"hereabouts publish FOLDER --to {sparql_server}" in fails(*words)
