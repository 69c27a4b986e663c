"""Views: tiles remember when what lies there was last viewed, and places how much of them was."""

from collections.abc import Callable

import numpy as np
import pytest

from kg.model.areas import Area, area_of
from kg.model.records import FREE, LOW, TALL, UNKNOWN, MapUpdate
from kg.serving.opening import create_map, in_memory_map, open_map
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.occupancy.occupancy_map import OccupancyMap, view_coverage
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.tiles import Key, States, ViewTimes
from mapping.places.layout import Layout, LayoutPlace
from perception.frames import Detections
from tests.mapping.occupancy.test_occupancy_map import WALL, look

__all__ = ["look"]  # a fixture

SETTINGS = OccupancySettings()
NOTHING = Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())


def times(minutes: dict[Key, int]) -> Callable[[Key], tuple[States, ViewTimes] | None]:
    """Tiles all of which were viewed at a minute, the left half (least x) from close by."""

    def of(key: Key) -> tuple[States, ViewTimes] | None:
        if key not in minutes:
            return None
        viewed = np.full((2, 16, 16), minutes[key], np.uint32)
        viewed[0, 8:] = 0
        return np.full((64, 64), UNKNOWN, np.uint8), viewed

    return of


def test_shares_are_of_the_area_across_tiles() -> None:
    area = Area(0.0, 6.4, 0.0, 3.2)
    found = view_coverage(area, times({(0, 0): 7, (1, 0): 9}), SETTINGS)
    assert found is not None
    assert (found.share, found.close_share, found.last) == (1.0, 0.5, 540.0)
    half = view_coverage(area, times({(1, 0): 9}), SETTINGS)
    assert half is not None
    assert (half.share, half.close_share) == (0.5, 0.25)
    assert view_coverage(area, times({}), SETTINGS) is None


def test_a_room_hardly_viewed_is_not_rounded_up_to_one_that_was_looked_at() -> None:
    viewed = np.zeros((2, 16, 16), np.uint32)
    viewed[1, 2:14, 7] = 5  # 12 of 256 cells
    tile = np.full((64, 64), FREE, np.uint8), viewed
    area = Area(0.0, 3.2, 0.0, 3.2)
    found = view_coverage(area, lambda key: tile if key == (0, 0) else None, SETTINGS)
    assert found is not None
    assert found.share == pytest.approx(12 / 256, abs=0.001) and found.close_share == 0


def test_cells_on_the_border_of_an_area_do_not_count() -> None:
    """What is beyond the wall is in view in them as well."""
    assert view_coverage(Area(-3.0, 0.1, 0.0, 3.2), times({(0, 0): 5}), SETTINGS) is None


def test_nothing_is_out_of_view_inside_a_wardrobe() -> None:
    """Its front is tall, and what is behind the front was never observed."""
    states, viewed = np.full((64, 64), FREE, np.uint8), np.full((2, 16, 16), 5, np.uint32)
    viewed[:, 4:8, 12:] = 0  # 0.8 m wide, 0.8 m deep
    states[16:32, 48:] = UNKNOWN
    area = Area(0.0, 3.2, 0.0, 3.2)

    def share() -> float:
        found = view_coverage(
            area, lambda key: (states, viewed) if key == (0, 0) else None, SETTINGS
        )
        assert found is not None
        return found.share

    assert share() == pytest.approx(
        1 - 16 / 256, abs=0.01
    )  # it could as well be floor behind a couch
    states[16:32, 48:50] = LOW
    assert share() == pytest.approx(1 - 16 / 256, abs=0.01)
    states[16:32, 48:50] = TALL
    assert share() == pytest.approx(1 - 8 / 248, abs=0.01)  # the front, and 0.2 m behind it
    states[16:18, 48:] = states[30:32, 48:] = TALL
    assert share() == 1.0


def test_an_area_may_lie_anywhere_and_be_of_any_shape() -> None:
    triangle = area_of([[(-3.2, -3.2), (0.0, -3.2), (-3.2, 0.0)]])
    found = view_coverage(triangle, times({(-1, -1): 5}), SETTINGS)
    assert found is not None
    assert found.share == 1.0
    assert found.close_share == pytest.approx(0.75, abs=0.03)  # the half beside the right angle
    for x in (1e9, 1e300):
        assert view_coverage(Area(0.0, x, 0.0, x), times({(0, 0): 5}), SETTINGS) is None
        assert view_coverage(Area(x, x * 2, 0.0, 1.0), times({(0, 0): 5}), SETTINGS) is None


def test_a_tile_in_the_graph_has_the_minutes_of_its_views(semantic_map, look) -> None:
    occupancy = OccupancyMap(semantic_map)
    for stamp in (6e8, 6e8 + 120):
        occupancy.add(look(WALL, stamp=stamp))
    semantic_map.apply(MapUpdate(floor=occupancy.take_rest()))
    tiles = {(tile.column, tile.row): tile for tile in semantic_map.floor()}
    viewed = tiles[0, 0].viewed
    assert viewed is not None
    assert viewed.shape == (2, 16, 16)
    assert set(np.unique(viewed)) == {0, 10**7 + 2}
    assert viewed[1, 9, 1] == 10**7 + 2  # floor at (1.9, 0.3), less than 2 m from the camera ...
    assert viewed[0, 13, 1] == 0  # ... and at (2.7, 0.3), more than that
    assert viewed[1, 13, 1] == 10**7 + 2
    assert viewed[1, 0, 0] == 0  # below the camera
    again = OccupancyMap(semantic_map)  # another run goes on from there
    again.add(look(WALL, at=(0.0, 2.0, 1.2), stamp=6e8 + 600))
    semantic_map.apply(MapUpdate(floor=again.take_rest()))
    later = {(tile.column, tile.row): tile for tile in semantic_map.floor()}[0, 0].viewed
    assert later is not None
    assert {10**7 + 2, 10**7 + 10} <= set(np.unique(later))


def test_floors_and_tops_are_viewed_but_no_fronts(look) -> None:
    front = ((2.252, 3.0), (-1.0, 1.0), (0.0, 2.5))
    for box, viewed in ((front, False), (((2.2, 3.0), (-1.0, 1.0), (0.0, 0.7)), True)):
        with in_memory_map() as semantic_map:
            occupancy = OccupancyMap(semantic_map)
            occupancy.add(look(box, stamp=6e8))
            tiles = {(tile.column, tile.row): tile.viewed for tile in occupancy.take_rest()}
        assert tiles[0, 0] is not None
        assert bool(tiles[0, 0][1, 9, 1])  # floor at (1.9, 0.3)
        assert bool(tiles[0, 0][1, 11, 1]) == viewed  # the box at (2.3, 0.3)


def test_views_alone_are_not_written_at_each_frame(semantic_map, look) -> None:
    occupancy = OccupancyMap(semantic_map)
    occupancy.add(look(WALL, stamp=6e8))
    assert occupancy.take_changed(6e8)
    written = []
    for seconds in range(6, 600, 6):
        occupancy.add(look(WALL, stamp=6e8 + seconds))
        if occupancy.take_changed(6e8 + seconds):
            written.append(seconds)
    assert len(written) <= 4


def test_a_place_knows_how_much_of_it_was_viewed(tmp_path, look) -> None:
    near, far = Area(0.0, 3.0, -1.0, 1.0), Area(20.0, 23.0, -1.0, 1.0)
    layout = Layout((LayoutPlace(1, "near", near), LayoutPlace(2, "far", far)))
    path = tmp_path / "views.map"
    with (
        create_map(path) as semantic_map,
        Mapper(semantic_map, MappingOptions(layout=layout)) as mapper,
    ):
        mapper.add(look(WALL, stamp=6e8), NOTHING)
        mapper.add(look(WALL, at=(0.5, 0.5, 1.2), stamp=6e8 + 60), NOTHING)
    with open_map(path, read_only=True) as semantic_map:
        one, other = semantic_map.places()
        assert one.viewed is not None
        assert 0.3 < one.viewed.share < 0.9
        assert 0 < one.viewed.close_share < one.viewed.share
        assert one.viewed.last == 6e8 + 60
        assert other.viewed is None
        (row,) = semantic_map.query("status", category="cup", viewed=0.3).records()[:1]
        assert (row["placeLabel"], row["status"]) == ("near", "looked, none seen")
        values = {
            str(r["placeLabel"]): r["status"]
            for r in semantic_map.query("status", category="cup", viewed=0.95).records()
        }
        assert values == {"near": "hidden", "far": "never looked"}
