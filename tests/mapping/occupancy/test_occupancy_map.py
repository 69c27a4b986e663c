"""Depth becomes a floor: what is free, what stands there, what nobody has seen."""

from collections.abc import Callable

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import FREE, LOW, TALL, UNKNOWN, FloorTile
from kg.serving.opening import in_memory_map
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.recording_mapper import map_recording
from perception.frames import Frame

K = np.array([[140.0, 0.0, 79.5], [0.0, 140.0, 59.5], [0.0, 0.0, 1.0]])
SHAPE = (120, 160)
FAR = 50.0  # [m] where there is nothing to see
BOX = ((1.6, 2.0), (-0.3, 0.3), (0.0, 0.5))
WALL = ((3.0, 3.1), (-5.0, 5.0), (0.0, 2.5))

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
Look = Callable[..., Frame]


def rendered(boxes: tuple[Box, ...], T: np.ndarray, floor: float) -> np.ndarray:
    """Depth (h, w) [m] of boxes on a level floor: where each ray first meets one."""
    u, v = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    p_cam = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(SHAPE)])
    ray = np.einsum("ij,jrc->irc", T[:3, :3], p_cam)
    eye = T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = (floor - eye[2]) / ray[2]
        depth = np.where(ground > 0, ground, FAR)
        for sides in boxes:
            ends = [np.sort([(side - e) / r for side in pair], axis=0) for pair, e, r in
                    ((sides[i], eye[i], ray[i]) for i in range(3))]  # fmt: skip
            enters = np.max([low for low, _ in ends], axis=0)
            leaves = np.min([high for _, high in ends], axis=0)
            depth = np.where((enters > 0) & (enters <= leaves), np.minimum(depth, enters), depth)
    return np.minimum(depth, FAR).astype(np.float32)


@pytest.fixture
def look() -> Look:
    """Callable: boxes -> a frame from (x, y, z), looking along x and 20 degrees down."""

    def frame(*boxes, at=(0.0, 0.0, 1.2), floor=0.0, stamp=1e9):
        down = np.radians(20)
        forward = np.array([np.cos(down), 0.0, -np.sin(down)])
        T = np.eye(4)
        T[:3, :3] = np.stack([[0.0, -1.0, 0.0], np.cross(forward, [0.0, -1.0, 0.0]), forward], 1)
        T[:3, 3] = at
        depth = rendered(boxes, T, floor)
        return Frame(f"{stamp:.1f}", np.zeros((*SHAPE, 3), np.uint8), depth, K, T, stamp)

    return frame


def state(tiles: tuple[FloorTile, ...], x: float, y: float, storey: int = 0) -> int:
    """What the tiles say of the cell that holds (x, y) [m]."""
    for tile in tiles:
        i, j = ((np.array([x, y]) - tile.corner) / tile.resolution).astype(int)
        if tile.storey == storey and 0 <= i < len(tile.cells) and 0 <= j < len(tile.cells):
            return int(tile.cells[i, j])
    return UNKNOWN


def told(book: OccupancyMap, semantic_map: SemanticMap, *frames: Frame) -> tuple[FloorTile, ...]:
    """The floor in the graph after the frames and the end of the run."""
    from kg.model.records import MapUpdate

    for frame in frames:
        book.add(frame)
        semantic_map.apply(MapUpdate(floor=book.take_changed(frame.stamp)))
    semantic_map.apply(MapUpdate(floor=book.take_rest()))
    return semantic_map.floor()


def test_floor_is_free_up_to_a_wall_and_unknown_behind_it(semantic_map, look):
    tiles = told(OccupancyMap(semantic_map), semantic_map, look(WALL))
    assert {state(tiles, x, 0.0) for x in np.arange(1.4, 2.9, 0.1)} == {FREE}
    assert state(tiles, 3.02, 0.0) == TALL
    assert {state(tiles, x, 0.0) for x in np.arange(3.2, 6.0, 0.1)} == {UNKNOWN}
    assert state(tiles, 0.3, 0.0) == UNKNOWN  # below the picture
    assert state(tiles, -1.0, 0.0) == UNKNOWN  # behind the camera


def test_a_box_is_low_and_hides_the_floor_behind_it(semantic_map, look):
    tiles = told(OccupancyMap(semantic_map), semantic_map, look(BOX, WALL))
    assert {state(tiles, x, y) for x in (1.7, 1.8, 1.9) for y in (-0.2, 0.0, 0.2)} == {LOW}
    assert state(tiles, 2.4, 0.0) == UNKNOWN  # in its shadow
    assert state(tiles, 2.4, 0.9) == FREE  # beside it
    assert state(tiles, 3.02, 0.0) == TALL  # the wall, seen over it


def test_furniture_that_is_moved_away_leaves_free_floor_and_the_other_way_round(semantic_map, look):
    book, stamps = OccupancyMap(semantic_map), iter(range(10**9, 10**9 + 100))
    before = told(book, semantic_map, *(look(BOX, WALL, stamp=next(stamps)) for _ in range(20)))
    after = told(book, semantic_map, *(look(WALL, stamp=next(stamps)) for _ in range(12)))
    again = told(book, semantic_map, *(look(BOX, WALL, stamp=next(stamps)) for _ in range(12)))
    assert [state(tiles, 1.8, 0.0) for tiles in (before, after, again)] == [LOW, FREE, LOW]


def test_a_tile_is_written_after_a_pause_and_only_when_it_changed(semantic_map, look):
    book = OccupancyMap(semantic_map)
    boxes = [((1.6, 2.0), (y, y + 0.4), (0.0, 0.5)) for y in (-0.6, -0.2, 0.2)]
    counts = []
    for n, box in enumerate((*boxes, boxes[-1], boxes[-1])):
        book.add(look(box, WALL, stamp=1e9 + 0.8 * n))
        counts.append(len(book.take_changed(1e9 + 0.8 * n)))
    assert counts[0] > 0
    assert counts[1:3] == [0, 0]
    assert counts[3] > 0  # 2.4 s after the first
    book.take_rest()
    book.add(look(boxes[-1], WALL, stamp=1e9 + 60))
    assert book.take_changed(1e9 + 60) == ()


def test_a_few_cells_wait_for_the_end_of_the_run(semantic_map, look):
    book = OccupancyMap(semantic_map)
    told(book, semantic_map, look(WALL))
    post = ((2.0, 2.05), (0.0, 0.05), (0.0, 1.5))
    frames = [look(post, WALL, stamp=1e9 + 10 + n) for n in range(5)]
    for frame in frames:
        book.add(frame)
        assert book.take_changed(frame.stamp) == ()
    assert {tile.changed for tile in book.take_rest()} == {frames[-1].stamp}


def test_another_run_goes_on_from_the_graph(semantic_map, look):
    told(OccupancyMap(semantic_map), semantic_map, look(BOX, WALL))
    later = OccupancyMap(semantic_map)
    tiles = told(later, semantic_map, look(BOX, WALL, at=(0.0, 2.0, 1.2), stamp=1e9 + 99))
    assert state(tiles, 1.8, 0.0) == LOW  # known from the first run
    assert state(tiles, 2.4, 2.9) == FREE  # seen in the second only


@pytest.mark.parametrize("kept", [1, 1000])
def test_tiles_that_could_not_be_written_are_told_again(semantic_map, look, kept):
    book = OccupancyMap(semantic_map, OccupancySettings(kept=kept))
    book.add(look(WALL, stamp=1e9))
    lost = book.take_changed(1e9) + book.take_rest()
    assert book.take_rest() == ()
    book.undo(lost)
    again = book.take_rest()
    assert len(again) == len(lost) > 1
    assert {tile.changed for tile in again} == {1e9}
    cells = {(tile.column, tile.row): tile.cells for tile in lost}
    assert all(np.array_equal(cells[tile.column, tile.row], tile.cells) for tile in again)


def test_memory_is_bounded_and_nothing_is_lost(semantic_map, look):
    book = OccupancyMap(semantic_map, OccupancySettings(kept=3))
    reference = OccupancyMap(in_memory_map())
    for n in range(6):
        frame = look(WALL, at=(-8.0 * n, 0.0, 1.2), stamp=1e9 + n)
        told(book, semantic_map, frame)
        reference.add(frame)
        assert len(book._tiles) <= 9  # one frame's own tiles may be more than are kept
    seen = {(t.column, t.row): t.cells for t in reference.take_rest()}
    kept = {(t.column, t.row): t.cells for t in semantic_map.floor()}
    assert seen.keys() == kept.keys()
    assert all(np.array_equal(seen[key], kept[key]) for key in seen)


def test_what_a_person_deletes_is_learnt_afresh(semantic_map, look):
    book = OccupancyMap(semantic_map)
    told(book, semantic_map, look(BOX, WALL))
    semantic_map.update("DELETE { ?t ?p ?o } WHERE { ?t a here:FloorTile ; ?p ?o }", by="Ada")
    assert semantic_map.floor() == ()
    book.refresh()
    tiles = told(book, semantic_map, look(WALL, stamp=1e9 + 5))
    assert state(tiles, 1.8, 0.0) == FREE


def test_the_floor_above_is_a_storey_of_its_own(semantic_map, look):
    book = OccupancyMap(semantic_map)
    up = look(((3.0, 3.1), (-5.0, 5.0), (3.0, 5.0)), at=(0.0, 0.0, 4.2), floor=3.0, stamp=1e9 + 9)
    tiles = told(book, semantic_map, look(BOX, WALL), up)
    assert {tile.storey: tile.height for tile in tiles} == {0: 0.0, 1: 3.0}
    assert (state(tiles, 1.8, 0.0, 0), state(tiles, 1.8, 0.0, 1)) == (LOW, FREE)
    again = OccupancyMap(semantic_map)  # another run knows both
    assert told(again, semantic_map, up)[0].storey == 0
    assert {tile.storey for tile in semantic_map.floor()} == {0, 1}


def test_on_stairs_nothing_is_learnt(semantic_map, look):
    book = OccupancyMap(semantic_map)
    steps = tuple(((0.5 + 0.3 * n, 0.8 + 0.3 * n), (-1.0, 1.0), (0.0, 0.18 * n)) for n in range(12))
    book.add(look(*steps, at=(0.0, 0.0, 2.7)))
    assert book.take_rest() == ()


def test_edges_of_things_are_not_things(semantic_map, look):
    frame = look(BOX, WALL)
    depth = frame.depth.copy()
    blurred = (depth[:, :-1] + depth[:, 1:]) / 2  # as sensors smear what is before and behind
    edge = abs(np.diff(depth, axis=1)) > 0.5
    depth[:, :-1][edge] = blurred[edge]
    smeared = Frame("smeared", frame.rgb, depth, frame.K, frame.T_map_cam, frame.stamp)
    tiles = told(OccupancyMap(semantic_map), semantic_map, smeared)
    beside = [state(tiles, x, y) for x in np.arange(2.1, 2.9, 0.05) for y in (-0.6, 0.6)]
    assert not {LOW, TALL} & set(beside)


def test_a_recording_brings_its_floor_along(
    semantic_map, look, list_recording, scripted_detector, make_detections
):
    frames = [look(BOX, WALL, at=(0.0, 0.1 * n, 1.2), stamp=1e9 + 0.5 * n) for n in range(6)]
    frames.append(look(BOX, WALL, at=(0.0, 1.5, 1.2), stamp=1e9 + 3))
    detector = scripted_detector({}, make_detections())
    report = map_recording(list_recording(frames), semantic_map, detector)
    tiles = semantic_map.floor()
    assert (state(tiles, 1.8, 0.0), state(tiles, 3.02, 0.0)) == (LOW, TALL)
    assert max(tile.changed for tile in tiles) == frames[-1].stamp, "the rest is written, too"
    assert report.milliseconds["floor"] > 0
    before = semantic_map.sequence
    map_recording(list_recording(frames), semantic_map, detector)
    assert semantic_map.sequence == before  # all of it is in the map


def test_what_a_person_deletes_at_the_last_moment_stays_deleted(
    semantic_map, look, list_recording, scripted_detector, make_detections
):
    frames = [look(BOX, WALL, at=(0.0, 0.1 * n, 1.2), stamp=1e9 + 0.5 * n) for n in range(3)]

    def delete(report):
        if report.index == 2:
            every = "DELETE { ?t ?p ?o } WHERE { ?t a here:FloorTile ; ?p ?o }"
            semantic_map.update(every, by="Ada")

    detector = scripted_detector({}, make_detections())
    map_recording(list_recording(frames), semantic_map, detector, on_frame=delete)
    assert semantic_map.floor() == ()
