"""Every command on a map that lies behind a SPARQL server."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import rdflib
import rdflib.compare

from planner.cli import main

Prints = Callable[..., str]
BASE = "https://example.org/kitchen/"


def untimed(text: str) -> str:
    """The recording has no clock: its frames are as old as the run that maps them."""
    text = re.sub(r'here:viewTimes "[^"]*"', 'here:viewTimes ""', text)  # minutes of that clock
    return re.sub(r"20\d\d-\d\d-\d\d[T ][\d:]{5,8}", "2020-01-01T00:00:00", text)


def test_frames_mapped_into_a_server_make_the_map_they_make_in_a_folder(
    kitchen: Path,
    sparql_server: str,
    prints: Prints,
    shared: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    detector = shared("models/deimv2_femto_416.onnx")
    folder = tmp_path / "server" / "127.map"
    graphs = []
    # boxes are grown from the surface, which a map on a server does not have
    words = ("--base", BASE, "--detector", detector, "--surface", "none", "--json")
    for into in (folder, sparql_server):
        report = json.loads(prints("map", kitchen, "--into", into, *words))
        assert report["frames"] == 8
        out = tmp_path / "out.ttl"
        prints("export", into, "-o", out)
        graph = rdflib.Graph().parse(data=untimed(out.read_text()), format="turtle")
        graph.remove((rdflib.URIRef(BASE), None, None))  # its title and when it was made
        graph.remove((rdflib.URIRef(f"{BASE}ontology"), rdflib.RDFS.label, None))  # has the title
        graphs.append(graph)
    assert len(graphs[0]) > 1000
    assert rdflib.compare.isomorphic(*graphs)

    again = json.loads(prints("map", kitchen, "--into", sparql_server, "--json"))
    assert (again["frames"], again["skipped"]) == (0, 8)
    here, there = (json.loads(prints("find", m, "cup", "--json")) for m in (folder, sparql_server))
    assert here["goals"]
    # one map is some seconds older than the other, so that probabilities and ages differ a little
    assert [(g["iri"], g["kind"]) for g in here["goals"]] == [
        (g["iri"], g["kind"]) for g in there["goals"]
    ]
    assert here["probability"] == pytest.approx(there["probability"], abs=0.01)
    first, also = here["steps"][0], there["steps"][0]
    assert [first[k] for k in ("x", "y", "heading")] == [also[k] for k in ("x", "y", "heading")]
    here, there = (
        untimed(prints("ask", m, "objects", "--format", "csv")) for m in (folder, sparql_server)
    )
    assert here == there
    assert prints("check", sparql_server) == ""
    prints("plot", sparql_server, "-o", tmp_path / "map.png", "--find", "banana")
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


def test_a_saved_map_can_be_imported_into_a_server(
    sparql_server: str, shared: Callable[[str], Path], prints: Prints
) -> None:
    objects = shared("reference/saved_objects_lab.json")
    assert (
        main(["import", "reference-maps", "--objects", str(objects), "--into", sparql_server]) == 0
    )
    assert json.loads(prints("ask", sparql_server, "summary", "--format", "json"))
