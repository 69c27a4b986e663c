"""Maps of different frames on one server, or merged: apart, until a transform between is known."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyoxigraph import NamedNode, Quad

from hereabouts.cli import main
from kg.maps.facts.coordinate_frames import frame_iri, frame_of, ways_to
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError, QueryParameterError
from kg.model.records import LookRecord, MapUpdate, PlaceRecord, RobotRecord, SearchRecord
from kg.model.transactions import Cause
from kg.serving.opening import create_map, in_memory_map, open_map
from kg.serving.publishing import merged
from kg.serving.server import BearerTokens, MapServer
from tests.kg.serving.publishing.test_publisher import NORTH, SOUTH, see
from tests.small_server import SMALL

CUP, CHAIR = f"{SOUTH}object/1", f"{NORTH}object/1"


def turned(degrees: float, x: float, y: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.fixture
def folders(tmp_path: Path) -> tuple[str, str]:
    """A chair and the robot in the north, a cup in the south; both at (1, 0.5)."""
    for title, base, label in (("north", NORTH, "chair"), ("south", SOUTH, "cup")):
        with create_map(tmp_path / title, base=base, title=title) as made:
            see(made, label, 1.0)
            kind = made.catalogue.find("kitchen", "place").iri
            room = PlaceRecord(made.place_iri(1), "room", -2, 4, -1, 3, 5, {kind: 0.9})
            pose = RobotRecord(np.array([0.0, 0.0, 0.0]), 0.0, 1e9)
            made.apply(MapUpdate(places=(room,), robot=pose))
    return str(tmp_path / "north"), str(tmp_path / "south")


@pytest.mark.parametrize("rule", ["viewpoints", "nearest-first"])
def test_find_on_a_server_of_two_maps_stays_in_one_frame(folders, url, capsys, rule):
    assert main(["publish", *folders, "--to", url, "--once"]) == 0
    assert "no way is known from" in capsys.readouterr().err
    words = ["find", url, "cup", "--rule", rule]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "is in the map south" in told
    assert "no way from the map north to it is known" in told
    assert f"hereabouts find {url} cup --in-map south" in told
    assert main([*words, "--json"]) == 0
    assert SOUTH not in capsys.readouterr().out
    assert main([*words, "--in-map", "south", "--json"]) == 0
    answer = capsys.readouterr().out
    assert CUP in answer
    assert NORTH not in answer


def test_a_known_transform_makes_one_plan_of_both(folders, url, capsys):
    north, south = folders
    pose = ["describe", south, "--relative-to", north, "--pose", "10,0,0,90", "--by", "ann"]
    assert main(pose) == 0
    assert f"relative to   {NORTH}crs" in capsys.readouterr().out
    assert main(["publish", north, south, "--to", url, "--once"]) == 0
    assert "no way is known" not in capsys.readouterr().err
    assert main(["find", url, "cup", "--json"]) == 0
    (known,) = json.loads(capsys.readouterr().out)["known"]
    assert (known["iri"], known["x"], known["y"]) == (CUP, 9.5, 1.0)
    assert known["where"].endswith("of the map south")
    with open_map(url, read_only=True) as both:
        near = both.objects(near=(9.5, 1.0), radius=0.1)
        assert [record.iri for record in near] == [CUP]
        assert both.query("objects-within-radius", x=9.5, y=1.0, radius=0.1).rows[0][0] == CUP


def test_a_chain_of_transforms_is_followed_both_ways(folders: tuple[str, str]) -> None:
    hall = "https://example.org/hall/crs"
    for folder, T in zip(folders, (turned(90, 1, 0), turned(-90, 0, 2)), strict=True):
        with open_map(folder) as one:
            one.place_frame(hall, T, by="ann")
    with merged(folders) as both:
        assert ways_to(both.engine, NORTH).keys() == {NORTH, SOUTH}
        expected = np.linalg.inv(turned(90, 1, 0)) @ turned(-90, 0, 2) @ (1.0, 0.5, 0.8, 1)
        (cup,) = both.objects("cup")
        assert np.allclose(cup.p_map, expected[:3], atol=0.01)


def test_merged_maps_without_a_way_compare_nothing(folders, capsys):
    with merged(folders) as both:
        assert {record.iri for record in both.objects()} == {CUP, CHAIR}
        assert [record.iri for record in both.objects(near=(1.0, 0.5))] == [CHAIR]
        within = both.query("objects-within-radius", x=1.0, y=0.5, radius=1.0).rows
        assert [row[0] for row in within] == [CHAIR]
        assert not [edge for edge in both.network(near=5.0).edges if {*edge} == {CUP, CHAIR}]
    members = ["--member", folders[0], "--member", folders[1]]
    assert main(["ask", *members, "objects", "--json"]) == 0
    said = capsys.readouterr()
    assert "no way is known from the frame of north to that of south" in said.err
    assert {row["object"] for row in json.loads(said.out)} == {CUP, CHAIR}


def test_agents_need_one_map(folders, url, capsys):
    assert main(["publish", *folders, "--to", url, "--once"]) == 0
    assert main(["mcp", url]) == 1
    assert "holds 2 maps (north, south)" in capsys.readouterr().err


def test_an_unknown_map_is_one_line_with_the_known_ones(folders: tuple[str, str]) -> None:
    with (
        merged(folders) as both,
        pytest.raises(QueryParameterError, match=r"north .*south .*did you mean"),
    ):
        both.in_one_frame("suoth")


def test_a_map_of_before_frames_has_one_too(folders: tuple[str, str]) -> None:
    north, south = folders
    with open_map(north) as old:
        held = tuple(old.store.engine.quads_for_pattern(None, None, None, v.DATASET_GRAPH))
        own = {NamedNode(frame_iri(NORTH)), NamedNode(NORTH)}
        frame = [quad for quad in held if quad.subject in own and "rame" in str(quad)]
        assert len(frame) == 3
        old.store.commit(frame, (), Cause("update"))
        assert frame_of(old.engine, NORTH) == frame_iri(NORTH)
        assert old.in_one_frame() is old
    with merged([north, south]) as both:
        assert [record.iri for record in both.in_one_frame().objects()] == [CHAIR]
    with open_map(north) as old:
        assert old.place_frame(frame_iri(SOUTH), turned(0, 1, 0), by="ann") is not None
        stated = Quad(
            NamedNode(NORTH),
            NamedNode(v.COORDINATE_FRAME),
            NamedNode(frame_iri(NORTH)),
            v.DATASET_GRAPH,
        )
        assert stated in old.store.native


def test_a_served_map_takes_its_frame_from_the_command(folders, monkeypatch):
    token = "a-token-of-the-tests-0123"
    monkeypatch.setenv("HEREABOUTS_TOKEN", token)
    settings = replace(SMALL, tokens=BearerTokens((("ann", token.encode()),)))
    with open_map(folders[1]) as south, MapServer(south, settings) as server:
        monkeypatch.setenv("HEREABOUTS_SERVER", server.url)
        words = ["describe", server.url, "--relative-to", folders[0], "--pose", "1,2,0,0"]
        assert main(words) == 0
        assert main(words) == 0
        texts = south.query("SELECT ?t { ?f here:relativeTo ?o ; here:transform ?t }").rows
        assert len(texts) == 1
        assert str(texts[0][0]).split()[3] == "1.0"


@pytest.mark.parametrize(
    "T", [np.eye(3), np.diag([1, -1, -1, 1.0]), np.diag([2, 2, 2, 1.0]), np.full((4, 4), np.nan)]
)
def test_a_transform_is_rigid_and_upright(T: np.ndarray) -> None:
    with in_memory_map(base=NORTH) as north:
        with pytest.raises(InvalidFactError, match="transform"):
            north.place_frame(frame_iri(SOUTH), T)
        with pytest.raises(InvalidFactError, match="relative to itself"):
            north.place_frame(frame_iri(NORTH), np.eye(4))
        assert north.sequence == 0


def test_what_has_coordinates_moves_and_keeps_its_size(folders: tuple[str, str]) -> None:
    """Objects, places, looks and the robot, by an odd turn."""
    T = turned(33, 4, -2)
    with open_map(folders[1]) as south:
        cup = south.catalogue.find("cup").iri
        search = SearchRecord(f"{SOUTH}search/1", ("cup",), (cup,), "found", 1e9, 1e9, 5.0, 0.1)
        look = LookRecord(
            f"{SOUTH}search/1/look/1", search.iri, 1, 1e9, (1.0, 2.0), 0.5, 1.0, (cup,)
        )
        south.apply(MapUpdate(search=search, looks=(look,)))
        area = south.places()[0].area.area
        south.place_frame(frame_iri(NORTH), T)
    with merged(folders) as both:
        place = next(place for place in both.places() if place.iri.startswith(SOUTH))
        assert place.outline
        assert place.area.area == pytest.approx(area)
        assert np.allclose(both.objects("cup")[0].p_map, (T @ (1.0, 0.5, 0.8, 1))[:3], atol=0.01)
        query = "SELECT ?x ?y ?h { <%s> here:x ?x ; here:y ?y ; here:heading ?h }"
        (row,) = both.query(query % look.iri).rows
        assert np.allclose(row, (*(T @ (1, 2, 0, 1))[:2], 0.5 + math.radians(33)), atol=0.01)
        (row,) = both.query(query % f"{SOUTH}robot").rows
        assert np.allclose(row, (4, -2, math.radians(33)), atol=0.01)
        robot = both.robot()
        assert robot is not None
        assert np.allclose(robot.p_map, 0)
