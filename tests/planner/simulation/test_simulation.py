import itertools
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.knowledge.ontology.catalogue import Catalogue
from kg.model.errors import LayoutError, RecordingError
from kg.serving.opening import in_memory_map
from perception.frames import Frame
from planner.simulation.camera import NOTHING, CameraModel, DepthSensor, SimulatedCamera
from planner.simulation.house import (
    FURNISHINGS,
    OBJECTS,
    FloorGrid,
    House,
    HouseRoom,
    Item,
    Solid,
    SolidPart,
    Wall,
    furnished_house,
)
from planner.simulation.house_robot import (
    START,
    MotionLimits,
    SimulatedTour,
    TimedPose,
    drive,
    look_around,
)
from planner.simulation.ray_casting import FAR, hit, rays_of
from planner.simulation.sensors import (
    LOOKS_LIKE,
    MISTAKEN_FOR,
    DetectorFaults,
    SimulatedDetector,
    SimulatedSceneClassifier,
)

metres = st.floats(-4, 4, allow_nan=False).map(lambda v: round(v, 3))
sizes = st.floats(0.05, 2.0).map(lambda v: round(v, 3))


@pytest.fixture(scope="module")
def catalogue() -> Catalogue:
    return in_memory_map().catalogue


@pytest.fixture(scope="module")
def camera() -> SimulatedCamera:
    return SimulatedCamera(furnished_house())


@pytest.fixture(scope="module")
def tour(camera: SimulatedCamera) -> SimulatedTour:
    return SimulatedTour(camera)


def frame_at(camera: SimulatedCamera, x: float, y: float, heading: float, name: str = "f") -> Frame:
    return camera.frame(name, camera.model.pose(x, y, heading), 0.0)


def one_room(*objects: Item) -> House:
    room = HouseRoom("box", "kitchen", 0, 6, 0, 6, "tiles", (0.8, 0.8, 0.8), ((3.0, 1.0),))
    corners = [(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)]
    ends = [(corners[0], corners[1]), (corners[3], corners[2])]
    ends += [(corners[0], corners[3]), (corners[1], corners[2])]
    return House((room,), tuple(Wall(a, b) for a, b in ends), objects)


# the house


def test_every_thing_stands_in_a_room_and_above_the_floor() -> None:
    house = furnished_house()
    for item in (*house.objects, *house.furnishings):
        x, y, _ = item.centre()
        assert house.room_at(x, y) is not None, item
        assert all(solid.lo[2] >= 0 and np.all(solid.hi > solid.lo) for solid in item.solids())


def test_every_label_is_a_category_of_the_ontology_by_that_very_name(catalogue: Catalogue) -> None:
    mistaken = {label for labels in MISTAKEN_FOR.values() for label in labels}
    for label in {*OBJECTS, *MISTAKEN_FOR, *mistaken}:
        assert catalogue.find(label, "object").label == label
    alike = {label for labels in LOOKS_LIKE.values() for label in labels}
    for label in {*LOOKS_LIKE, *alike, *(room.category for room in furnished_house().rooms)}:
        assert catalogue.find(label, "place").label == label


def test_what_is_taken_for_something_exists_under_a_name_of_its_own() -> None:
    assert set(MISTAKEN_FOR) <= set(OBJECTS)
    assert not set(OBJECTS) & set(FURNISHINGS)


def test_doorways_are_open_up_to_the_lintel() -> None:
    wall = Wall((0, 4), (10, 4), doors=((2, 3),))
    assert wall.pieces() == [(0, 2), (3, 10)]
    in_doorway = [s for s in wall.solids() if s.lo[0] <= 2.5 <= s.hi[0]]
    assert [s.lo[2] for s in in_doorway] == [2.05]


def test_a_front_looks_where_it_is_turned_to() -> None:
    part = SolidPart(0, 1, 0, 0.1, 0.1, 0.1, (1, 1, 1))
    centres = {
        facing: tuple(np.round((s.lo + s.hi)[:2] / 2, 6))
        for facing in ("north", "west", "south", "east")
        for s in [part.placed((0, 0, 0), facing)]
    }
    assert centres == {"north": (0, 1), "west": (-1, 0), "south": (0, -1), "east": (1, 0)}


# ray casting


def view_of(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Depth and points of 41 x 41 rays from the origin along x at `solid`."""
    span = np.linspace(-0.5, 0.5, 41)
    u, v = np.meshgrid(span, span)
    T = CameraModel(pitch=0.0, mount_height=0.0).pose(0, 0, 0)
    rays = rays_of(np.stack([u, v, np.ones_like(u)]).astype(np.float32), T)
    hits = hit(solid, rays, (slice(0, 41), slice(0, 41)))
    return hits.t, np.moveaxis(rays.direction * hits.t, 0, -1)


@given(st.floats(2, 5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), sizes)
@settings(max_examples=40)
def test_rays_end_on_the_surface_they_hit(x: float, y: float, z: float, size: float) -> None:
    centre, half = np.array([x, y, z]), np.array([size, size, size]) / 2
    for shape in ("box", "cylinder", "ellipsoid"):
        t, points = view_of(Solid(shape, centre - half, centre + half, (1, 1, 1)))
        offset = (points[t < FAR] - centre) / half
        if shape == "box":
            distance = np.abs(offset).max(axis=1)
        elif shape == "ellipsoid":
            distance = np.linalg.norm(offset, axis=1)
        else:
            distance = np.maximum(np.linalg.norm(offset[:, :2], axis=1), np.abs(offset[:, 2]))
        assert np.allclose(distance, 1, atol=2e-3)


# the camera


def test_every_pixel_of_an_object_lies_on_the_object(camera: SimulatedCamera) -> None:
    T = camera.model.pose(5.7, 6.1, 1.4)
    view = camera.view(T)
    rows, cols = np.nonzero(view.instance != NOTHING)
    K, depth = camera.model.K, view.depth[rows, cols]
    p_cam = np.stack([(cols - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones(len(rows))])
    p_map = (T[:3, :3] @ (p_cam * depth)).T + T[:3, 3]
    for instance in np.unique(view.instance[rows, cols]):
        solids = camera.house.objects[instance].solids()
        points = p_map[view.instance[rows, cols] == instance]
        lo = np.min([s.lo for s in solids], axis=0) - 1e-3
        hi = np.max([s.hi for s in solids], axis=0) + 1e-3
        assert np.all((points >= lo) & (points <= hi)), camera.house.objects[instance].label


def test_the_nearer_thing_hides_the_farther_one() -> None:
    near, far = Item("refrigerator", 3, 3), Item("refrigerator", 3, 5)
    view = SimulatedCamera(one_room(far, near)).view(CameraModel().pose(3, 0.6, pi / 2))
    pixels = {i: int((view.instance == i).sum()) for i in (0, 1)}
    assert pixels[1] > 4000 and pixels[0] < 0.1 * pixels[1]
    assert view.silhouette[1] == pytest.approx(pixels[1], rel=0.02)


def test_the_left_of_the_robot_is_the_left_of_the_picture() -> None:
    house = one_room(Item("chair", 2.0, 3.5), Item("couch", 4.2, 3.5))
    view = SimulatedCamera(house).view(CameraModel().pose(3, 0.6, pi / 2))
    chair, couch = (np.nonzero(view.instance == i)[1].mean() for i in (0, 1))
    assert chair < couch


def test_depth_noise_grows_with_distance_and_far_walls_give_none() -> None:
    house = replace(
        one_room(),
        walls=(
            Wall((-50, 3.0), (50, 3.0)),
            Wall((-50, -2.0), (50, -2.0)),
            Wall((-50, -20), (50, -20)),
        ),
    )
    level = CameraModel(pitch=0.0)
    camera = SimulatedCamera(house, level)
    centre = np.s_[110:130, 120:200]

    def spread(y: float, heading: float) -> tuple[float, float]:
        depth = frame_at(camera, 3.0, y, heading).depth[centre]
        return float(depth.mean()), float(depth.std())

    near, far = spread(1.95, pi / 2), spread(-1.0, pi / 2)
    assert near[0] == pytest.approx(1.0, abs=0.01) and far[0] == pytest.approx(3.95, abs=0.01)
    assert 0.0005 < near[1] < 0.004 < 0.015 < far[1] < 0.04
    assert np.isnan(frame_at(camera, 3.0, -2.5, -pi / 2).depth[centre]).all()


def test_the_same_frame_looks_the_same_again(camera: SimulatedCamera) -> None:
    detector = SimulatedDetector(camera)
    first = frame_at(camera, 5.7, 6.1, 1.4)
    seen = detector.detect(first)
    detector.detect(frame_at(camera, 6.7, 2.4, 0.1))
    again, other = frame_at(camera, 5.7, 6.1, 1.4), frame_at(camera, 5.7, 6.1, 1.4, name="g")
    assert np.array_equal(first.rgb, again.rgb)
    assert np.array_equal(first.depth, again.depth, equal_nan=True)
    assert not np.array_equal(first.depth, other.depth, equal_nan=True)
    twice = detector.detect(again)
    assert seen.label == twice.label and np.array_equal(seen.xyxy, twice.xyxy)


# the senses


def test_detections_lie_in_the_picture_best_first(camera, tour):
    detector = SimulatedDetector(camera)
    for frame in list(tour.frames(len(tour) - 12)):
        seen = detector.detect(frame)
        assert np.all(seen.xyxy >= 0)
        assert np.all(seen.xyxy[:, 2:] <= (320, 240))
        assert np.all(seen.xyxy[:, 2:] - seen.xyxy[:, :2] >= 1)
        assert np.all(np.diff(seen.score) <= 0)
        assert np.all((seen.score >= 0.3) & (seen.score <= 1))


@given(st.floats(4, 4000), st.floats(1, 10), st.floats(1.1, 3))
def test_recall_falls_with_distance_and_with_occlusion(camera, visible, hidden, more):
    chance = SimulatedDetector(camera).chance
    assert chance(visible, visible * hidden) <= chance(visible * more, visible * hidden * more)
    assert chance(visible, visible * hidden) >= chance(visible, visible * hidden * more)
    assert 0 <= chance(visible, visible) <= DetectorFaults().recall
    assert chance(900, 4500) < 0.1 < 0.8 < chance(900, 900)


def test_things_nearby_in_full_view_are_mostly_found_but_not_always() -> None:
    camera = SimulatedCamera(one_room(Item("chair", 3.0, 3.2)))
    detector = SimulatedDetector(camera)
    frames = [frame_at(camera, 3.0, 0.8, pi / 2, f"f{k}") for k in range(200)]
    found = sum("chair" in detector.detect(frame).label for frame in frames) / len(frames)
    assert 0.75 < found < 0.97


def test_a_careless_detector_gives_wrong_names_and_sees_ghosts() -> None:
    camera = SimulatedCamera(one_room(Item("chair", 3.0, 3.2)))
    careless = DetectorFaults(confusion=1.0, false_alarms=0.0)
    frames = [frame_at(camera, 3.0, 0.8, pi / 2, f"f{k}") for k in range(40)]
    seen = {s for f in frames for s in SimulatedDetector(camera, careless).detect(f).label}
    assert seen and seen <= set(MISTAKEN_FOR["chair"])
    dreaming = SimulatedDetector(SimulatedCamera(one_room()), DetectorFaults(false_alarms=2.0))
    assert sum(len(dreaming.detect(frame)) for frame in frames) > 40


def test_scenes_mostly_tell_the_room_in_view(camera: SimulatedCamera, catalogue: Catalogue) -> None:
    labels = [c.label for c in catalogue.categories if c.kind == "place"]
    classifier = SimulatedSceneClassifier(camera, labels)
    tops = []
    for k in range(40):
        scores = classifier.classify(frame_at(camera, 1.9, 6.7, 2.6, f"f{k}")).probability
        assert sum(scores.values()) == pytest.approx(1) and set(scores) == set(labels)
        tops.append(max(scores, key=lambda label: scores[label]))
    assert 0.6 * len(tops) < tops.count("kitchen") < len(tops)
    assert set(tops) <= {"kitchen", *LOOKS_LIKE["kitchen"]}


def test_a_scene_through_a_doorway_is_that_of_the_room_behind(camera: SimulatedCamera) -> None:
    classifier = SimulatedSceneClassifier(camera, [room.category for room in camera.house.rooms])
    looking_in = classifier.room_seen(frame_at(camera, 5.65, 5.0, pi / 2))
    assert looking_in is not None and looking_in.name == "dining room"


def test_a_classifier_that_lacks_a_room_is_refused(camera: SimulatedCamera) -> None:
    with pytest.raises(ValueError, match=r"lacks .*kitchen"):
        SimulatedSceneClassifier(camera, ["bedroom"])


# moving


@given(st.lists(st.tuples(metres, metres), min_size=1, max_size=5), st.floats(-3, 3))
def test_a_drive_ends_at_its_last_corner_in_small_steps(corners, heading):
    gait = MotionLimits()
    start = TimedPose(0.0, 0.0, heading, 0.0)
    poses = [start, *drive(start, np.array(corners), gait)]
    assert np.allclose(poses[-1].xy, corners[-1], atol=1e-5)
    for a, b in itertools.pairwise(poses):
        angle = abs((b.heading - a.heading + pi) % (2 * pi) - pi)
        step = float(np.linalg.norm(b.xy - a.xy))
        assert step <= gait.stride + 1e-9 and angle <= gait.swing + 1e-9
        assert b.seconds - a.seconds == pytest.approx(
            step / gait.speed + angle / gait.turn_rate, abs=1e-6
        )


@given(st.floats(-3.1, 3.1))
def test_looking_around_ends_where_it_began(heading: float) -> None:
    poses = list(look_around(TimedPose(1, 2, heading, 5.0), MotionLimits()))
    assert poses[-1].heading == pytest.approx(heading, abs=1e-9)
    assert poses[-1].seconds == pytest.approx(5 + 2 * pi / 0.8)
    assert len({round(pose.heading, 6) for pose in poses}) == 12


def test_the_way_between_rooms_leads_through_doorways() -> None:
    house = furnished_house()
    floor = FloorGrid(house)
    path = floor.path(np.array([2.3, 3.0]), np.array([9.2, 6.3]))
    points = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)])
    for level, doors in ((4.0, ((2.1, 3.2),)), (5.4, ((8.9, 9.8),))):
        crossing = points[np.argmin(np.abs(points[:, 1] - level))]
        assert any(a < crossing[0] < b for a, b in doors)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length < 1.25 * np.hypot(9.2 - 2.3, 6.3 - 3.0)
    assert np.linalg.norm(path[-1] - (9.2, 6.3)) < 0.1


def test_a_goal_inside_furniture_is_approached_not_entered() -> None:
    house = furnished_house()
    floor = FloorGrid(house)
    end = floor.path(np.array([2.3, 3.0]), np.array([5.7, 7.5]))[-1]
    table = next(item for item in house.objects if item.label == "dining table").solids()[0]
    assert not np.all((end > table.lo[:2]) & (end < table.hi[:2]))
    assert np.linalg.norm(end - (5.7, 7.5)) < 1.5


def test_a_house_without_free_floor_is_refused() -> None:
    full = replace(
        one_room(),
        furnishings=tuple(
            Item("wardrobe", x, y) for x in np.arange(0, 6.5, 0.7) for y in np.arange(0, 6.5, 0.3)
        ),
    )
    with pytest.raises(LayoutError, match="no free floor"):
        FloorGrid(full).path(np.array([1.0, 1.0]), np.array([2.0, 2.0]))


# the tour


def test_a_tour_looks_into_every_room_and_touches_nothing(tour: SimulatedTour) -> None:
    house = furnished_house()
    visited = {
        room.name
        for x, y in (pose.xy for pose in tour.poses)
        if (room := house.room_at(x, y)) is not None
    }
    assert visited == {room.name for room in house.rooms}
    solids = [s for i in (*house.objects, *house.furnishings) for s in i.solids()]
    for x, y in (pose.xy for pose in tour.poses):
        for solid in solids:
            inside = solid.lo[0] < x < solid.hi[0] and solid.lo[1] < y < solid.hi[1]
            assert not (inside and solid.lo[2] < 1.2 and solid.hi[2] > 0.05)


def test_a_tour_can_be_read_again_from_any_frame(tour: SimulatedTour) -> None:
    late = list(tour.frames(len(tour) - 2))
    assert [frame.id for frame in late] == [f"frame-{len(tour) - k:06d}" for k in (2, 1)]
    again = next(tour.frames(len(tour) - 1))
    assert np.array_equal(late[-1].depth, again.depth, equal_nan=True)
    assert late[0].stamp < late[1].stamp == START + tour.poses[-1].seconds
    assert 250 <= len(tour) <= 350
    assert list(tour.frames(len(tour))) == []
    with pytest.raises(RecordingError, match="not 9999"):
        next(tour.frames(9999))


def test_a_depth_sensor_has_a_range():
    depth = np.array([[0.3, 0.7, 3.0, 5.8, 6.5]], np.float32)
    always, rng = np.ones(depth.shape, np.bool_), np.random.default_rng(0)
    measured = DepthSensor(0.5, 6.0).measure(depth, np.ones_like(depth), always, rng)
    assert np.isnan(measured).tolist() == [[True, False, False, False, True]]
