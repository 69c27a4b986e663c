"""Looks of a search count as views: what was looked for in vain is gone, not never looked for."""

from pathlib import Path

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.records import FREE, TALL, UNKNOWN, FloorTile, MapUpdate
from kg.serving.opening import create_map, in_memory_map, open_map
from mapping.occupancy.occupancy_settings import OccupancySettings
from planner.execution.protocol import RobotPose
from planner.execution.search_log import SearchLog
from planner.search.goals.status import status
from planner.search.viewpoints.candidate_views import FloorView
from tests.planner.robots import START, ring, run

SETTINGS = OccupancySettings()


def floor(known: float = 10.0) -> tuple[FloorTile, ...]:
    """Free floor where x and y are 0 to 8 m, as far as x is less than `known` [m]; walls around."""
    side = np.arange(3 * SETTINGS.side) * SETTINGS.cell
    within = (side < 8.0)[:, None] & (side < 8.0)
    cells = np.where(within, FREE, TALL).astype(np.uint8)
    cells[side >= known] = UNKNOWN
    parts = [(i, j) for i in range(3) for j in range(3)]
    n = SETTINGS.side
    return tuple(
        FloorTile(0, i, j, 0.0, 0.05, cells[n * i : n * (i + 1), n * j : n * (j + 1)].copy(), START)
        for i, j in parts
    )


def views(semantic_map: SemanticMap) -> dict[str, str]:
    return {one.place_label: one.value for one in status(semantic_map, "cup").places}


def test_after_a_search_in_vain_status_says_where_it_was_looked_for(tmp_path: Path) -> None:
    with create_map(tmp_path / "cut.map") as semantic_map:
        ring(semantic_map)
        semantic_map.apply(MapUpdate(floor=floor()))
        assert set(views(semantic_map).values()) == {"never looked"}
        outcome = run(semantic_map, "apple", budget=12.0)
        assert outcome.state == "given up"
        first = views(semantic_map)
        assert "never looked" in first.values()
        assert set(first.values()) != {"never looked"}
    with open_map(tmp_path / "cut.map") as semantic_map:
        assert views(semantic_map) == first
        run(semantic_map, "apple", resume=True)
        assert set(views(semantic_map).values()) == {"looked, none seen"}
        viewed = [place.viewed for place in semantic_map.places()]
        assert all(one is not None and one.close_share < one.share for one in viewed)
        assert {one.last for one in viewed if one} == {START + 60}
        assert not check_map(semantic_map.store.native)


def test_floor_that_no_depth_has_shown_does_not_count() -> None:
    with in_memory_map() as semantic_map:
        ring(semantic_map)
        run(semantic_map, "apple", budget=12.0)
        assert semantic_map.floor() == ()
        assert all(place.viewed is None for place in semantic_map.places())
        semantic_map.apply(MapUpdate(floor=floor(known=3.0)))
        run(semantic_map, "apple")
        found = views(semantic_map)
        assert found["place 2"] == "never looked"  # the kitchen is beyond
        assert found["place 1"] == "hidden"


def test_a_view_of_coarse_cells_leaves_no_gaps_and_only_near_ones_are_close() -> None:
    with in_memory_map() as semantic_map:
        ring(semantic_map)
        semantic_map.apply(MapUpdate(floor=floor()))
        middles = np.arange(0.25, 4.0, 0.5)
        p_map = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        view = FloorView(p_map, np.where(p_map[:, 0] < 2.0, 1.0, 3.0), 0.5)
        kinds = [semantic_map.catalogue.find("cup").iri]
        log = SearchLog.begin(semantic_map, ["cup"], kinds, lambda: START)
        log.look(RobotPose(1.0, 1.0, 0.0), 0.0, 1.0, kinds, viewed=[view])
        corridor = semantic_map.places()[0].viewed
        assert corridor is not None
        assert (corridor.share, corridor.close_share) == pytest.approx((1.0, 0.5))


def test_looks_and_a_writer_of_the_same_floor_do_not_undo_each_other() -> None:
    with in_memory_map() as semantic_map:
        ring(semantic_map)
        semantic_map.apply(MapUpdate(floor=floor(known=3.0)))
        kinds = [semantic_map.catalogue.find("cup").iri]
        log = SearchLog.begin(semantic_map, ["cup"], kinds, lambda: START)
        semantic_map.apply(MapUpdate(floor=floor()))  # a mapper has seen more meanwhile
        view = FloorView(np.array([[0.5, 0.5], [5.0, 0.5]]), np.array([1.0, 1.0]), 0.2)
        log.look(RobotPose(1.0, 1.0, 0.0), 0.0, 1.0, kinds, viewed=[view])
        log.end("given up", None)
        tiles = {(t.column, t.row): t for t in semantic_map.floor()}
        assert all((t.cells != UNKNOWN).all() for t in tiles.values())
        assert [int((tiles[k].viewed[1] > 0).sum()) for k in ((0, 0), (1, 0))] == [1, 1]
