"""Floor, robot, recordings and searches in the map."""

import base64
import math
import zlib
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pyoxigraph import Quad, Store

from kg.export.serialization import export_text
from kg.knowledge.ontology.lint import check_map
from kg.maps.facts.occupancy import decoded, encoded, iri_of, tile_of, tiles_of_rows
from kg.maps.facts.robot import recording_quads, recordings_in, robot_in, robot_quads
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError, ShapeError
from kg.model.records import (
    FREE,
    LOW,
    FloorTile,
    LookRecord,
    MapUpdate,
    ObstacleRecord,
    RecordingRecord,
    RobotRecord,
    SearchRecord,
)
from kg.serving.opening import in_memory_map

BASE = "https://example.org/map/"
CELLS = np.zeros((64, 64), np.uint8)
CELLS[10:20] = FREE
TILE = FloorTile(0, 2, -1, 0.0, 0.05, CELLS, 1e9)


tiles = st.builds(
    FloorTile,
    storey=st.integers(0, 9),
    column=st.integers(-300, 300),
    row=st.integers(-300, 300),
    height=st.integers(-1000, 1000).map(lambda cm: cm / 100),
    resolution=st.sampled_from([0.05, 0.1, 0.025]),
    cells=st.sampled_from([8, 64]).flatmap(
        lambda n: hnp.arrays(np.uint8, (n, n), elements=st.integers(0, 3))
    ),
    changed=st.integers(0, 4 * 10**9).map(float),
)


@settings(max_examples=20)  # a map each
@given(st.lists(tiles, max_size=4, unique_by=lambda t: (t.storey, t.column, t.row)))
def test_tiles_come_back_as_they_were_from_map_and_query(some):
    with in_memory_map(base=BASE) as semantic_map:
        semantic_map.apply(MapUpdate(floor=tuple(some)))
        asked = tiles_of_rows(semantic_map.query("goals-floor").records())
        held = semantic_map.floor()
        assert all(tile_of(semantic_map.engine, iri_of(BASE, tile)) for tile in some)
    wanted = {(t.storey, t.column, t.row): t for t in some}
    for found in (asked, held):
        assert len(found) == len(some)
        for tile in found:
            same = wanted[tile.storey, tile.column, tile.row]
            assert np.array_equal(same.cells, tile.cells)
            for name in ("height", "resolution", "changed"):
                assert getattr(same, name) == getattr(tile, name)


ROW = {
    "iri": f"{BASE}floor/0/2_-1",
    "storey": 0,
    "x": 6.4,
    "y": -3.2,
    "z": 0.0,
    "cellSize": 0.05,
    "cells": encoded(CELLS),
    "changed": datetime.fromtimestamp(1e9, UTC),
}


@pytest.mark.parametrize(
    "wrong",
    [{"changed": "then"}, {"cells": "?"}, {"storey": -1}, {"x": "left"}, {"x": 6.5}, {"y": None},
     {"z": float("nan")}, {"cellSize": 0}, {"cellSize": True}, {"storey": 0.5}],
)  # fmt: skip
def test_a_row_that_is_no_tile_is_left_out(wrong):
    assert tiles_of_rows([{**ROW, **wrong}, ROW])[0].column == 2
    assert tiles_of_rows([{**ROW, **wrong}]) == ()
    assert len(tiles_of_rows([ROW, {**ROW, "storey": 4}])) == 1  # of one thing, one tile


def test_times_of_views_come_back_with_their_tile(semantic_map):
    viewed = np.zeros((2, 16, 16), np.uint32)
    viewed[:, 3, 4], viewed[1, 5, 6] = 2**32 - 1, 28_000_000
    semantic_map.apply(MapUpdate(floor=(replace(TILE, viewed=viewed),)))
    (found,) = semantic_map.floor()
    assert np.array_equal(found.viewed, viewed)


def test_a_changed_tile_replaces_what_was_known_and_nothing_else(semantic_map):
    semantic_map.apply(MapUpdate(floor=(TILE, replace(TILE, column=3))))
    semantic_map.update(f"INSERT DATA {{ <{iri_of(BASE, TILE)}> rdfs:label 'the hall' }}")
    changed = replace(TILE, cells=np.full((64, 64), LOW, np.uint8), changed=1e9 + 7)
    assert len(semantic_map.apply(MapUpdate(floor=(changed,)))) == 4  # cells and time, old and new
    here, there = semantic_map.floor()
    assert (here.cells == LOW).all() and here.changed == 1e9 + 7
    assert np.array_equal(there.cells, CELLS)
    assert semantic_map.query("SELECT ?t { ?t rdfs:label 'the hall' }").rows
    assert semantic_map.apply(MapUpdate(floor=(changed,))) is None


def test_a_floor_is_well_made_and_goes_out_as_linked_data(semantic_map):
    semantic_map.apply(MapUpdate(floor=(TILE,)))
    assert check_map(semantic_map.engine.quads_for_pattern(None, None, None, None)) == []
    turtle = export_text(semantic_map, "ttl")
    cells = base64.b64decode(encoded(CELLS)).hex().upper()  # a type that OWL 2 has
    assert "here:FloorTile" in turtle and cells in turtle
    assert "2_-1" in turtle


def test_what_cannot_be_a_tile_is_refused_and_nothing_written(semantic_map):
    shapes = ((1, 4, 4), (2, 4, 3), (2, 0, 0), (2, 4), (2, 1025, 1025))
    for wrong, message in (
        ({"cells": np.zeros((3, 4), np.uint8)}, "cells must be"),
        ({"cells": np.full((4, 4), 9, np.uint8)}, "cells must be 0 to 3"),
        ({"resolution": 0.0}, "resolution above 0"),
        ({"storey": -1}, "storey 0 or more"),
        ({"height": float("nan")}, "finite"),
        ({"changed": float("inf")}, "seconds since 1970"),
        *(({"viewed": np.zeros(shape, np.uint32)}, r"must be \(2, m, m\)") for shape in shapes),
    ):
        with pytest.raises(InvalidFactError, match=message):
            semantic_map.apply(MapUpdate(floor=(replace(TILE, **wrong),)))
    assert semantic_map.floor() == ()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "not base64!",
        base64.b64encode(b"not zlib").decode(),
        base64.b64encode(zlib.compress(bytes(5))).decode(),  # not square
        base64.b64encode(zlib.compress(b"\x07" * 16)).decode(),  # no such state
        base64.b64encode(zlib.compress(bytes(16))[:-2]).decode(),  # cut short
        base64.b64encode(zlib.compress(bytes(5_000_000))).decode(),  # would fill the memory
    ],
)
def test_what_anybody_may_have_written_is_no_tile(semantic_map, text):
    assert decoded(text) is None
    semantic_map.apply(MapUpdate(floor=(TILE,)))
    old = encoded(CELLS)
    node = f"<{iri_of(BASE, TILE)}>"
    change = (
        f'DELETE DATA {{ {node} here:floorCells "{old}"^^xsd:base64Binary }} ; '
        f'INSERT DATA {{ {node} here:floorCells "{text}"^^xsd:base64Binary }}'
    )
    try:
        semantic_map.update(change)
    except ShapeError:
        return  # refused at the door already
    assert semantic_map.floor() == ()


def test_a_tile_without_its_cells_is_refused_at_the_door(semantic_map):
    with pytest.raises(ShapeError, match="here:floorCells"):
        semantic_map.update("INSERT DATA { <floor/0/0_0> a here:FloorTile ; here:storey 0 }")


def test_the_past_of_a_tile_is_told_in_words(semantic_map):
    semantic_map.apply(MapUpdate(floor=(TILE,)))
    changed = replace(TILE, cells=np.full((64, 64), LOW, np.uint8), changed=1e9 + 7)
    semantic_map.apply(MapUpdate(floor=(changed,)))
    first, then = semantic_map.history.events("floor/0/2_-1")
    assert "new floor tile" in first.words
    lengths = [len(encoded(tile.cells)) for tile in (TILE, changed)]
    assert f"{lengths[0]} characters -> {lengths[1]} characters" in then.words


def test_a_tile_beyond_all_measure_is_no_tile(semantic_map):
    def write(x: str, size: str) -> None:
        semantic_map.update(
            "INSERT DATA { <floor/0/9_0> a here:FloorTile ; here:storey 0 ; here:y 0.0e0 ; "
            f"here:z 0.0e0 ; here:x {x} ; here:cellSize {size} ; "
            f'here:floorCells "{encoded(CELLS)}"^^xsd:base64Binary ; '
            'sosa:resultTime "2020-01-01T00:00:00Z"^^xsd:dateTime }'
        )

    with pytest.raises(ShapeError, match="at most 1e6 m"):
        write("1.6e300", "0.05e0")
    write("0.0e0", "1.0e308")
    assert semantic_map.floor() == ()


ROBOT_BASE = "http://example.org/lab/"

metres = st.floats(-1e4, 1e4)
stamps = st.floats(0, 4e9)
texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


def stored(quads: list[Quad]) -> Store:
    store = Store()
    store.extend(quads)
    return store


@given(metres, metres, st.floats(-math.pi, math.pi), stamps)
def test_the_robot_comes_back(x: float, y: float, heading: float, stamp: float) -> None:
    store = stored(robot_quads(RobotRecord(np.array([x, y, 1.0]), heading, stamp), ROBOT_BASE))
    back = robot_in(store, ROBOT_BASE)
    assert back is not None
    np.testing.assert_allclose(back.p_map, [x, y, 1.0], atol=0.00501)
    assert back.heading == pytest.approx(heading, abs=0.00501)
    assert back.stamp == pytest.approx(stamp, abs=0.501)


@given(texts, st.lists(st.floats(-1e9, 1e9), min_size=16, max_size=16))
def test_a_recording_comes_back_with_its_transform_to_the_last_bit(name, numbers):
    record = RecordingRecord(name, 57, "frame-000056", np.array(numbers).reshape(4, 4))
    (back,) = recordings_in(stored(recording_quads(record, ROBOT_BASE)), ROBOT_BASE)
    assert (back.name, back.frames_applied, back.last_frame) == (name, 57, "frame-000056")
    np.testing.assert_array_equal(back.T_map_world, record.T_map_world)


CUP, APPLE = v.HERE + "Cup", v.HERE + "Apple"
SEARCH = SearchRecord(
    iri=f"{BASE}search/1",
    words=("apple", "something to drink from"),
    categories=(APPLE, CUP),
    state="found",
    started=1e9,
    ended=1e9 + 60,
    seconds=58.5,
    left=0.25,
    found=(f"{BASE}object/3",),
)
LOOK = LookRecord(
    iri=f"{BASE}search/1/look/1",
    search=SEARCH.iri,
    number=1,
    stamp=1e9 + 5,
    position=(1.25, -2.5),
    heading=0.5,
    extent=1.0123,
    categories=(APPLE, CUP),
    found=(f"{BASE}object/3",),
    glimpses=((1.0, -2.0, 0.25), (1.25, -2.25, 0.5)),
)
OBSTACLE = ObstacleRecord(
    f"{BASE}search/1/obstacle/1", SEARCH.iri, 1, 1e9 + 7, (3.5, 0.75), "a closed door"
)


def test_a_search_comes_back_as_it_was(semantic_map: SemanticMap) -> None:
    second = replace(LOOK, iri=f"{SEARCH.iri}/look/2", number=2, found=(), glimpses=())
    drive = RecordingRecord("search/1", 3, "frame-2", np.eye(4))  # pictures on the way
    semantic_map.apply(
        MapUpdate(search=SEARCH, looks=(second, LOOK), obstacles=(OBSTACLE,), recording=drive)
    )
    assert [recording.name for recording in semantic_map.recordings()] == ["search/1"]
    searches = semantic_map.searches
    assert searches.all() == (SEARCH,)
    assert searches.looks(SEARCH.iri) == (LOOK, second)
    assert searches.obstacles(SEARCH.iri) == (OBSTACLE,)
    assert searches.looks(f"{BASE}search/2") == searches.obstacles(f"{BASE}search/2") == ()
    assert check_map(semantic_map.engine) == []


def test_the_state_of_a_search_replaces_its_last_one(semantic_map: SemanticMap) -> None:
    running = replace(SEARCH, state="running", ended=None, left=1.0, found=())
    other = replace(running, iri=f"{BASE}search/10")
    for search in (other, running, SEARCH):
        semantic_map.apply(MapUpdate(search=search))
    assert semantic_map.searches.all() == (SEARCH, other)


def test_a_search_that_cannot_be_is_refused(semantic_map: SemanticMap) -> None:
    before = semantic_map.sequence
    for wrong, message in (
        (MapUpdate(search=replace(SEARCH, left=1.01)), "left"),
        (MapUpdate(search=replace(SEARCH, left=-0.01)), "left"),
        (MapUpdate(search=replace(SEARCH, words=())), "needs .*words and"),
        (MapUpdate(search=replace(SEARCH, categories=())), "needs .*words and"),
        (MapUpdate(search=replace(SEARCH, state="lost")), "running, stopped, found"),  # type: ignore[arg-type]
        (MapUpdate(looks=(replace(LOOK, glimpses=((0.0, math.nan, 0.0),)),)), "glimpses"),
        (MapUpdate(looks=(replace(LOOK, position=(math.inf, 0.0)),)), "position"),
    ):
        with pytest.raises(InvalidFactError, match=message):
            semantic_map.apply(wrong)
    assert semantic_map.sequence == before
