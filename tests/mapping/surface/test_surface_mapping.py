"""The surface of a map: what was seen is there, what is gone is not, people never are."""

import functools
import shutil
import signal
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest

from kg.maps.surface.surface_store import FILE
from kg.maps.surface.voxels import Surface
from kg.model.errors import GraphError
from kg.serving.opening import create_map, in_memory_map, open_map
from lab.houses.random_house import random_house
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.frames import Detections, Frame
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house_robot import SimulatedTour
from tests.waiting import program

OPTIONS = MappingOptions(occupancy=False, check_poses=False)
FRAMES = 70
THING = (slice(14, 34), slice(20, 44))  # pixels
RED = (200, 30, 30)


def same(one: Surface, other: Surface) -> bool:
    return one.size == other.size and all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("points", "colours", "count", "last_seen")
    )


@pytest.fixture
def scene(make_frame):
    """Callable: stamp, whether a red thing stands 1 m in front of a wall in 2 m."""

    def make(stamp: float, thing: bool) -> Frame:
        depth = np.full((49, 65), 2.0, np.float32)
        if thing:
            depth[THING] = 1.0
        frame = make_frame(depth, stamp=stamp, id=f"frame-{stamp:.0f}")
        frame.rgb[:] = 90
        if thing:
            frame.rgb[THING] = RED
        return frame

    return make


@pytest.fixture
def nothing(make_detections) -> Detections:
    return make_detections()


def near(surface: Surface) -> np.ndarray:
    """Whether each voxel is the thing's."""
    return surface.points[:, 0] < 1.5


def test_voxels_are_where_the_camera_saw_them_in_their_colour(scene, nothing):
    with in_memory_map() as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        for second in range(3):
            mapper.add(scene(1000.0 + second, True), nothing)
        surface = semantic_map.surface()
        thing = near(surface)
        assert surface.size == 0.025 and 100 < thing.sum() < len(surface)
        assert np.abs(surface.points[thing, 0] - 1.0).max() <= 0.0126
        assert np.abs(surface.points[~thing, 0] - 2.0).max() <= 0.0126
        assert (surface.colours[thing] == RED).all() and (surface.colours[~thing] == 90).all()
        assert (surface.count == 3).all() and (surface.last_seen == 1002).all()
        assert len(semantic_map.surface(min_count=4)) == 0


def test_a_thing_that_is_gone_leaves_the_present_and_stays_in_the_past(tmp_path, scene, nothing):
    with create_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        mapper.add(scene(1000.0, False), nothing)
        before = semantic_map.sequence
        for second in range(1, 6):
            mapper.add(scene(1000.0 + second, True), nothing)
        there = semantic_map.sequence
        for second in range(6, 46):
            mapper.add(scene(1000.0 + second, False), nothing)
        assert not near(semantic_map.surface()).any()
    with open_map(tmp_path / "a.map", read_only=True) as semantic_map:
        assert not near(semantic_map.surface()).any() and len(semantic_map.surface()) > 100
        with semantic_map.at(before) as past:
            assert not near(past.surface()).any() and len(past.surface()) > 100
        with semantic_map.at(there) as past:
            assert near(past.surface()).sum() > 100
        assert len(semantic_map.snapshot().surface()) == len(semantic_map.surface())


@pytest.mark.parametrize(("depth", "left"), [(1.05, True), (1.15, False)])
def test_what_is_hardly_in_front_of_what_is_measured_stays(make_frame, nothing, depth, left):
    with in_memory_map() as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        for second in range(46):
            where = 1.0 if second < 6 else depth
            mapper.add(make_frame(where, stamp=1000.0 + second, id=f"frame-{second}"), nothing)
        middle = np.abs(semantic_map.surface().points - (1.0, 0.0, 1.0)) < (0.02, 0.2, 0.2)
        assert middle.all(1).any() == left


@pytest.mark.parametrize("there", [True, False])
def test_what_only_lost_frames_saw_go_or_come_is_as_before(tmp_path, scene, nothing, there):
    def see(until: int) -> None:
        with open_map(tmp_path / "a.map") as semantic_map:
            mapper = Mapper(semantic_map, OPTIONS, recording="room")
            for second in range(mapper.frames_applied, until):
                mapper.add(scene(1000.0 + second, (second < 6) == there), nothing)
            mapper.flush()

    create_map(tmp_path / "a.map").close()
    see(6)
    shutil.copytree(tmp_path / "a.map", tmp_path / "b.map")
    before = near(surface(tmp_path / "b.map", 0)).sum()
    see(46)
    assert (before > 100) == there != near(surface(tmp_path / "a.map", 0)).any()
    shutil.copy(tmp_path / "a.map" / FILE, tmp_path / "b.map" / FILE)
    assert near(surface(tmp_path / "b.map", 0)).sum() == before


def test_people_are_left_out(scene, make_detections):
    boxes = make_detections(("person", 0.3, (20.0, 14.0, 43.0, 33.0)))
    with in_memory_map() as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        mapper.add(scene(1000.0, True), boxes)
        surface = semantic_map.surface()
        assert len(surface) > 100 and not near(surface).any()
        assert not (surface.colours == RED).all(1).any()


def test_without_a_surface_nothing_is_kept(tmp_path, scene, nothing):
    options = MappingOptions(occupancy=False, check_poses=False, surface=None)
    with create_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, options) as mapper:
        mapper.add(scene(1000.0, True), nothing)
        assert len(semantic_map.surface()) == 0
    assert not (tmp_path / "a.map" / FILE).exists()


def test_a_full_surface_says_so_in_one_line(monkeypatch, scene, nothing):
    monkeypatch.setattr("kg.maps.surface.voxels.MAX_VOXELS_OF_A_MAP", 200)
    with in_memory_map() as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        for second in range(8):
            mapper.add(scene(1000.0 + second, True), nothing)
        assert len(semantic_map.surface()) <= 200
        (line,) = mapper.problems
        assert "--surface 5 in a new map would work" in line and "\n" not in line


@functools.cache
def tour() -> tuple[Frame, ...]:
    recording = SimulatedTour(SimulatedCamera(random_house(77), seed=77))
    return tuple(next(recording.frames(number)) for number in range(FRAMES))


def go_on(folder: Path, until: int = FRAMES, say: bool = False) -> None:
    """Map the frames that the map does not hold yet; `say` prints the number of each."""
    nothing = Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
    with open_map(folder) as semantic_map:
        mapper = Mapper(semantic_map, OPTIONS, recording="tour")
        for frame in tour()[mapper.frames_applied : until]:
            mapper.add(frame, nothing)
            if say:
                sys.stdout.write(f"{mapper.frames_applied}\n")
                sys.stdout.flush()
        mapper.flush()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "a.map"
    create_map(folder).close()
    go_on(folder)
    return folder


def surface(folder: Path, min_count: int = 1) -> Surface:
    with open_map(folder, read_only=True) as semantic_map:
        return semantic_map.surface(min_count=min_count)


def test_a_run_that_is_killed_makes_the_same_surface(tmp_path, uninterrupted):
    folder = tmp_path / "a.map"
    create_map(folder).close()
    text = (
        "import runpy; from pathlib import Path\n"
        f"runpy.run_path({str(Path(__file__))!r})['go_on'](Path({str(folder)!r}), say=True)\n"
    )
    with program(text) as running:
        assert running.stdout is not None
        assert any(int(line) >= 66 for line in running.stdout)
        running.send_signal(signal.SIGKILL)
    go_on(folder)
    assert len(surface(uninterrupted)) > 5000
    assert same(surface(folder), surface(uninterrupted))


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(b"no database" * 100),
        lambda path: path.write_bytes(path.read_bytes()[:9000]),
        lambda path: filled(path, "CREATE VIEW more AS SELECT 1"),
        lambda path: filled(path, "UPDATE chunks SET data = x'00'"),
        lambda path: filled(path, "UPDATE chunks SET voxels = voxels - 1"),
    ],
    ids=["text", "cut", "a view", "no chunk", "few voxels"],
)
def test_a_damaged_file_is_named_in_one_line(tmp_path, uninterrupted, damage):
    shutil.copytree(uninterrupted, tmp_path / "a.map")
    damage(tmp_path / "a.map" / FILE)
    with (
        open_map(tmp_path / "a.map", read_only=True) as semantic_map,
        pytest.raises(GraphError, match=r"cannot use the surface at .*move the file away") as told,
    ):
        semantic_map.surface()
    assert "\n" not in str(told.value)


def filled(path: Path, sql: str) -> None:
    with sqlite3.connect(path) as file:
        file.execute(sql)
    file.close()
