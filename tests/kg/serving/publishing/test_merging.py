"""Several maps asked as one, merged in memory."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.model.errors import GraphError, MapNotFoundError
from kg.serving.opening import create_map, in_memory_map
from kg.serving.publishing.publisher import merged
from kg.serving.server import MapServer, Settings
from tests.kg.serving.publishing.test_publisher import NORTH, SOUTH, own, see


@pytest.fixture
def north(tmp_path: Path) -> str:
    path = tmp_path / "north.map"
    with create_map(path, base=NORTH) as made:
        see(made, "cup", 1.0)
        see(made, "chair", 2.0)
    return str(path)


def test_folders_and_served_maps_are_joined_in_one_query(north: str) -> None:
    with in_memory_map(base=SOUTH) as south:
        see(south, "chair", 1.0)
        south.update('INSERT DATA { <object/1> rdfs:comment "worn" }')
        with MapServer(south, Settings(port=0)) as server, merged([north, server.url]) as both:
            query = "SELECT ?a ?b { ?a a here:Cup ; here:x ?x . ?b a here:Chair ; here:x ?x }"
            assert both.query(query).rows == ((f"{NORTH}object/1", f"{SOUTH}object/1"),)
            assert len(both.query("objects-by-category", category="chair").rows) == 2
            assert own(south.engine) <= own(both.engine)
            assert both.query("SELECT ?x { <object/1> here:x ?x }").rows == ((1.0,),)
            with pytest.raises(GraphError, match="open for reading only"):
                both.update("DELETE WHERE { ?s ?p ?o }")


def test_the_command_merges_its_members(
    north: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    south = tmp_path / "south.map"
    with create_map(south, base=SOUTH) as made:
        see(made, "cup", 3.0)
    words = ["ask", "--member", north, "--member", str(south), "--json"]
    assert main([*words, "objects-by-category", "-p", "category=cup"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["object"] for row in rows} == {f"{NORTH}object/1", f"{SOUTH}object/1"}
    assert main([*words, "-e", "SELECT (COUNT(*) AS ?n) { ?o here:existence ?e }"]) == 0
    assert json.loads(capsys.readouterr().out) == [{"n": 3}]
    with pytest.raises(SystemExit):
        main([*words, "objects", "--at", "#1"])


def test_a_member_that_is_missing_or_given_twice_is_one_line(north: str, tmp_path: Path) -> None:
    with pytest.raises(MapNotFoundError):
        merged([north, str(tmp_path / "gone.map")])
    with pytest.raises(GraphError, match="is the same map as"):
        merged([north, north])
