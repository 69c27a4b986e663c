"""The floor as facts: the same tiles come back, and what is no tile is none."""

from __future__ import annotations

import base64
import zlib
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from kg.export.serialization import export_text
from kg.knowledge.ontology.lint import check_map
from kg.maps.facts.occupancy import decoded, encoded, iri_of, tile_of, tiles_of_rows
from kg.model.errors import InvalidFactError, ShapeError
from kg.model.records import FREE, LOW, FloorTile, MapUpdate
from kg.serving.opening import in_memory_map

BASE = "https://example.org/map/"
CELLS = np.zeros((64, 64), np.uint8)
CELLS[10:20] = FREE
TILE = FloorTile(0, 2, -1, 0.0, 0.05, CELLS, 1e9)


a_few = settings(max_examples=25)  # a map each
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


@a_few
@given(tiles)
def test_a_tile_comes_back_as_it_was(tile):
    with in_memory_map(base=BASE) as semantic_map:
        semantic_map.apply(MapUpdate(floor=(tile,)))
        (found,) = semantic_map.floor()
        assert tile_of(semantic_map.engine, iri_of(BASE, tile)).column == tile.column
    assert np.array_equal(found.cells, tile.cells)
    for name in ("storey", "column", "row", "height", "resolution", "changed"):
        assert getattr(found, name) == getattr(tile, name)


@a_few
@given(st.lists(tiles, max_size=4, unique_by=lambda t: (t.storey, t.column, t.row)))
def test_the_question_for_the_floor_gives_the_same_tiles(some):
    with in_memory_map(base=BASE) as semantic_map:
        semantic_map.apply(MapUpdate(floor=tuple(some)))
        asked = tiles_of_rows(semantic_map.query("goals-floor").records())
        held = semantic_map.floor()
    by_number = {(t.storey, t.column, t.row): t for t in asked}
    assert len(asked) == len(by_number) == len(held) == len(some)
    for tile in held:
        same = by_number[tile.storey, tile.column, tile.row]
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


@pytest.mark.parametrize("shape", [(1, 4, 4), (2, 4, 3), (2, 0, 0), (2, 4), (2, 1025, 1025)])
def test_times_of_views_of_another_shape_are_refused(semantic_map, shape):
    with pytest.raises(InvalidFactError, match=r"must be \(2, m, m\)"):
        semantic_map.apply(MapUpdate(floor=(replace(TILE, viewed=np.zeros(shape, np.uint32)),)))
    assert semantic_map.floor() == ()


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


def test_the_floor_of_then_can_be_asked_for(semantic_map):
    semantic_map.apply(MapUpdate(floor=(TILE,)))
    then = semantic_map.sequence
    semantic_map.apply(MapUpdate(floor=(replace(TILE, cells=CELLS * LOW),)))
    with semantic_map.at(then) as past:
        (tile,) = past.floor()
    assert np.array_equal(tile.cells, CELLS)


def test_a_floor_is_well_made_and_goes_out_as_linked_data(semantic_map):
    semantic_map.apply(MapUpdate(floor=(TILE,)))
    assert check_map(semantic_map.engine.quads_for_pattern(None, None, None, None)) == []
    turtle = export_text(semantic_map, "ttl")
    cells = base64.b64decode(encoded(CELLS)).hex().upper()  # a type that OWL 2 has
    assert "here:FloorTile" in turtle and cells in turtle
    assert "2_-1" in turtle


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cells": np.zeros((3, 4), np.uint8)}, "cells must be"),
        ({"cells": np.full((4, 4), 9, np.uint8)}, "cells must be 0 to 3"),
        ({"resolution": 0.0}, "resolution above 0"),
        ({"storey": -1}, "storey 0 or more"),
        ({"height": float("nan")}, "finite"),
        ({"changed": float("inf")}, "seconds since 1970"),
    ],
)
def test_what_cannot_be_a_tile_is_refused_and_nothing_written(semantic_map, wrong, message):
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
        base64.b64encode(zlib.compress(bytes(50_000_000))).decode(),  # would fill the memory
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
    assert "new here:FloorTile" in first.words
    lengths = [len(encoded(tile.cells)) for tile in (TILE, changed)]
    assert f"{lengths[0]} characters -> {lengths[1]} characters" in then.words


@pytest.mark.parametrize(("x", "size"), [("1.6e300", "0.05e0"), ("0.0e0", "1.0e308")])
def test_a_tile_beyond_all_measure_is_no_tile(semantic_map, x, size):
    semantic_map.update(
        "INSERT DATA { <floor/0/9_0> a here:FloorTile ; here:storey 0 ; here:y 0.0e0 ; "
        f"here:z 0.0e0 ; here:x {x} ; here:cellSize {size} ; "
        f'here:floorCells "{encoded(CELLS)}"^^xsd:base64Binary ; '
        'sosa:resultTime "2020-01-01T00:00:00Z"^^xsd:dateTime }'
    )
    assert semantic_map.floor() == ()
