"""Transforms and camera messages of ROS."""

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.model.errors import RecordingError
from perception.camera.poses import pose_from_quaternion
from perception.sources.ros.image_messages import intrinsics_of
from perception.sources.ros.transform_tree import TransformTree
from tests.perception.sources.ros.messages import camera_info, transform

HALF = float(np.sqrt(0.5))


def tree(*moving: Message, static: tuple[Message, ...] = ()) -> TransformTree:
    made = TransformTree()
    made.add_message(Message(transforms=list(moving)), static=False)
    made.add_message(Message(transforms=list(static)), static=True)
    return made


def position(made: TransformTree, parent: str, child: str, stamp: float) -> np.ndarray:
    T = made.at(parent, child, stamp)
    assert T is not None
    return T[:3, 3]


def test_links_are_followed_up_and_down() -> None:
    made = tree(
        transform("map", "odom", 1.0, (1, 0, 0)),
        transform("odom", "base", 1.0, (0, 2, 0), (0, 0, HALF, HALF)),
        static=(
            transform("base", "colour", 0.0, (0.5, 0, 1)),
            transform("base", "depth", 0.0, (0.5, 0.1, 1)),
        ),
    )
    T = made.at("map", "colour", 1.0)
    assert T is not None
    assert np.allclose(T[:3, 3], (1, 2.5, 1))
    assert np.allclose(T[:3, 0], (0, 1, 0))
    between = position(made, "depth", "colour", 99.0)  # joined by static links alone
    assert np.allclose(between, (0, -0.1, 0))
    assert np.allclose(made.at("/colour", "map", 1.0) @ T, np.eye(4))  # names of ROS 1 may have /


def test_poses_between_two_stamps_are_interpolated() -> None:
    made = tree(
        transform("map", "camera", 10.0, (0, 0, 0)),
        transform("map", "camera", 10.5, (1, 2, 0), (0, 0, HALF, HALF)),
    )
    T = made.at("map", "camera", 10.25)
    assert T is not None
    assert np.allclose(T[:3, 3], (0.5, 1, 0))
    assert np.allclose(T[:3, 0], (np.cos(np.pi / 4), np.sin(np.pi / 4), 0))


def test_the_pose_at_a_stamp_is_that_pose_to_the_last_bit() -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(20, 7))
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    made = tree(*(transform("map", "camera", i / 30, r[:3], r[3:]) for i, r in enumerate(rows)))
    for i, row in enumerate(rows):
        alone = tree(transform("map", "camera", i / 30, row[:3], row[3:]))
        stamp = round(i / 30 * 1e9) / 1e9
        assert np.array_equal(made.at("map", "camera", stamp), alone.at("map", "camera", stamp))


def test_order_of_arrival_does_not_matter() -> None:
    rows = [transform("map", "camera", t, (t, 0, 0)) for t in (3.0, 1.0, 2.0, 2.5)]
    assert position(tree(*rows), "map", "camera", 2.25)[0] == pytest.approx(2.25)


@pytest.mark.parametrize("stamp", [0.9, 4.1, 2.5])
def test_no_pose_before_the_first_after_the_last_and_in_a_long_gap(stamp: float) -> None:
    made = tree(*(transform("map", "camera", t, (t, 0, 0)) for t in (1.0, 4.0)))
    assert made.at("map", "camera", stamp) is None
    assert made.at("map", "camera", 4.01) is not None  # within the tolerance


@pytest.mark.parametrize("stamps", [(5.0,), (1.0, 9.0)])
def test_corrections_of_odometry_hold_however_seldom_they_come(stamps: tuple[float, ...]) -> None:
    odometry = [transform("odom", "base", t / 10, (t / 10, 0, 0)) for t in range(100)]
    corrections = [transform("map", "odom", t, (0, 2, 0)) for t in stamps]
    made = tree(*odometry, *corrections)
    for stamp in (0.5, 5.5, 9.5):
        assert np.allclose(position(made, "map", "base", stamp), (stamp, 2, 0))


def test_only_corrections_of_odometry_hold() -> None:
    head = [transform("base", "head", t / 10, (0, 0, 1)) for t in range(100)]
    made = tree(*head, transform("map", "base", 1.0, (0, 0, 0)))
    assert made.at("map", "head", 5.0) is None, "a lost robot is nowhere"
    assert tree(transform("map", "odom", 1.0, (0, 0, 0))).at("map", "odom", 5.0) is None


def test_live_the_next_correction_is_waited_for_as_long_as_others_are_a_second_apart() -> None:
    made = TransformTree(kept=100)
    odometry = [transform("odom", "base", t, (t, 0, 0)) for t in (1.0, 1.5, 2.0, 2.5)]
    for link in (transform("map", "odom", 1.0, (0, 2, 0)), *odometry):
        made.add_message(Message(transforms=[link]), static=False)
    assert made.at("map", "base", 1.5) is None
    assert np.allclose(position(made, "map", "base", 2.5), (2.5, 2, 0))


def test_static_transforms_hold_for_ever() -> None:
    made = tree(static=(transform("map", "camera", 5.0, (1, 2, 3)),))
    for stamp in (0.0, 5.0, 1e10):
        assert np.allclose(position(made, "map", "camera", stamp), (1, 2, 3))
    assert made.span("map", "camera") is None


def test_a_head_that_turns_by_static_transforms_is_where_the_last_one_before_says() -> None:
    places = {5.0: (1, 2, 3), 8.0: (4, 5, 6)}
    made = tree(static=tuple(transform("map", "camera", t, p) for t, p in places.items()))
    for stamp, there in ((5.0, 5.0), (7.9, 5.0), (8.0, 8.0), (99.0, 8.0), (0.0, 8.0)):
        assert np.allclose(position(made, "map", "camera", stamp), places[there])
    kept = TransformTree(kept=3)  # live
    for n in range(50):
        kept.add("map", "camera", n * 10**9, (n, 0, 0, 0, 0, 0, 1), static=True)
    assert position(kept, "map", "camera", 49.0)[0] == 49
    assert len(kept._links["camera"]["map"]) <= 6


def test_loops_and_missing_links_are_said() -> None:
    loop = tree(transform("a", "b", 1), transform("b", "c", 1), transform("c", "a", 1))
    with pytest.raises(RecordingError, match=r"form a loop: \w -> \w -> \w -> \w$"):
        loop.at("a", "b", 1.0)
    apart = tree(transform("map", "base", 1), transform("head", "camera", 1))
    with pytest.raises(RecordingError, match=r"'camera' .*'head'.* to 'map' .*'map'"):
        apart.at("map", "camera", 1.0)
    with pytest.raises(RecordingError, match="of frame 'camara'; did you mean camera"):
        apart.at("map", "camara", 1.0)


def test_transforms_that_are_none() -> None:
    for bad in (
        transform("map", "camera", 1, (np.nan, 0, 0)),
        transform("map", "camera", 1, (0, 0, 0), (0, 0, 0, 0)),
        transform("map", "camera", 1, (0, 0, 0), (np.inf, 0, 0, 1)),
        transform("map", "map", 1),
        transform("", "map", 1),
    ):
        made = TransformTree()
        (why,) = made.add_message(Message(transforms=[bad, transform("a", "b", 1)]), static=False)
        assert why.startswith("transform ")
        assert made.frames == ("a", "b")  # the others of the message hold


def test_of_two_parents_the_preferred_one_counts() -> None:
    made = tree(*(transform("odom", "base", t) for t in (1, 2, 3)), transform("map", "base", 1))
    assert made.parent("base") == "odom"
    made.prefer("map", "base")
    assert made.parent("base") == "map"


@given(
    st.lists(st.floats(-50, 50), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
)
def test_there_and_back_is_where_one_was(t: list[float], q: list[float]) -> None:
    unit = np.array(q) / np.linalg.norm(q)
    made = tree(transform("map", "a", 1, t, unit), transform("map", "b", 1, (1, 2, 3)))
    there, back = made.at("a", "b", 1.0), made.at("b", "a", 1.0)
    assert np.allclose(there @ back, np.eye(4), atol=1e-9)
    assert np.allclose(made.at("map", "a", 1.0), pose_from_quaternion(np.array(t), unit, ""))


def test_a_tree_has_so_many_links_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("perception.sources.ros.transform_tree.MAX_LINKS", 3)
    made = tree(*(transform("map", f"robot {n}", 1.0, (n, 0, 0)) for n in range(3)))
    one_more = Message(transforms=[transform("map", "robot 3", 1.0, (3, 0, 0))])
    (refused,) = made.add_message(one_more, static=False)
    assert "3 other links" in refused
    known = Message(transforms=[transform("map", "robot 2", 2.0, (5, 0, 0))])
    assert made.add_message(known, static=False) == []


def test_raw_images_follow_k_and_rectified_ones_p() -> None:
    message = camera_info(d=np.array([0.1, -0.2, 0.0, 0.0, 0.3]))
    raw = intrinsics_of(message, "info")
    assert (raw.fx, raw.fy, raw.cx, raw.cy) == (500, 510, 320, 240)
    assert raw.dist == (0.1, -0.2, 0.0, 0.0, 0.3)
    assert raw.size == (640, 480)
    rectified = intrinsics_of(message, "info", rectified=True)
    assert (rectified.fx, rectified.fy, rectified.cx, rectified.cy) == (400, 410, 310, 230)
    assert rectified.dist == ()


def test_ros1_calls_the_fields_by_capitals() -> None:
    fields = vars(camera_info())
    ros1 = Message(**{("DKP"["dkp".index(k)] if k in "dkp" else k): v for k, v in fields.items()})
    assert not hasattr(ros1, "k")
    assert intrinsics_of(ros1, "info").fy == 510


def test_a_region_of_interest_moves_the_principal_point() -> None:
    roi = Message(x_offset=100, y_offset=40, width=200, height=300, do_rectify=False)
    found = intrinsics_of(camera_info(roi=roi), "info")
    assert (found.cx, found.cy) == (220, 200)
    assert found.size == (200, 300)


def test_binned_images_scale_the_camera() -> None:
    found = intrinsics_of(camera_info(), "info").fitted(320, 240)
    assert found.fx == 250


@pytest.mark.parametrize("d", [(0.1, -0.02, 0.0, 0.001), (0.1, -0.02, 0.0, 0.001, 0.0), ()])
def test_fisheye_cameras(d: tuple[float, ...]) -> None:
    found = intrinsics_of(camera_info(distortion_model="equidistant", d=np.array(d)), "info")
    assert found.fisheye
    assert found.distorted, "without coefficients, too, it is no pinhole camera"
    assert found.dist == ((*d[:4],) or (0.0,) * 4)
    rectified = intrinsics_of(camera_info(distortion_model="equidistant"), "info", rectified=True)
    assert not rectified.distorted


def test_a_camera_that_its_projection_alone_tells_is_read_where_nothing_has_to_be_undone() -> None:
    fields = {"k": np.zeros(9), "d": np.zeros(5)}
    found = intrinsics_of(camera_info(**fields), "info")
    assert found == intrinsics_of(camera_info(), "info", rectified=True)
    assert not found.distorted
    with pytest.raises(RecordingError, match="info is not calibrated"):
        intrinsics_of(camera_info(k=np.zeros(9), p=np.zeros(12)), "info")


def test_cameras_that_cannot_be_used() -> None:
    with pytest.raises(RecordingError, match="info is not calibrated"):
        intrinsics_of(camera_info(k=np.zeros(9), d=np.ones(5)), "info")
    for model, count in (("equidistant", 6), ("omni", 4)):
        other = camera_info(distortion_model=model, d=np.full(count, 0.1))
        with pytest.raises(RecordingError, match=rf"'{model}' with {count} .*image_rect"):
            intrinsics_of(other, "info")
    with pytest.raises(RecordingError, match="with 3 coefficients"):
        intrinsics_of(camera_info(d=np.ones(3)), "info")
    with pytest.raises(RecordingError, match="finite"):
        intrinsics_of(camera_info(k=np.full(9, np.nan)), "info").fitted(640, 480)


def two_publishers(second: float, *, every: int = 1, beside: float = 0.0) -> TransformTree:
    """odom -> base_link by one publisher, and by another that is `second` [m] beside it."""
    tree = TransformTree()
    for i in range(40):
        x = 0.05 * i
        tree.add("odom", "base_link", i * 10**8, (x, 0, 0, 0, 0, 0, 1))
        if i % every == 0:
            stamp = i * 10**8 + int(beside * 1e9)
            tree.add("odom", "base_link", stamp, (x + second, second, 0, 0, 0, 0, 1))
    return tree


@pytest.mark.parametrize("beside", [0.0, 0.02, 0.05])
@pytest.mark.parametrize("every", [1, 5])
def test_two_publishers_of_one_transform_that_contradict_are_told(every, beside):
    found, angle = two_publishers(0.3, every=every, beside=beside).contradiction("base_link")
    assert found == pytest.approx(0.42, abs=0.1)
    assert angle == 0


def test_one_publisher_that_is_recorded_twice_or_jumps_once_contradicts_nothing():
    assert two_publishers(0.0).contradiction("base_link") == (0, 0)
    tree = TransformTree()
    for i in range(40):
        tree.add("map", "odom", i * 10**8, (0.8 * (i > 20), 0, 0, 0, 0, 0, 1))
    assert tree.contradiction("odom") == (0, 0)


LEVEL, TURNED = (0, 0, 1, 0, 0, 0, 1), (0, 0, 1, 0, 0, 0.5, 0.75**0.5)
RAISED = (0, 0, 1.2, 0, 0, 0, 1)


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        ([(1, LEVEL, True), (1, RAISED, True)], (0.2, 0)),
        ([(1, LEVEL, True), (5, TURNED, True)], (0, np.pi / 3)),
        ([(1, LEVEL, True), (20, TURNED, True)], (0, 0)),  # a head that turns
        ([(1, LEVEL, True), (5, LEVEL, True)], (0, 0)),
        ([(20, RAISED, False), (1, LEVEL, True), (21, TURNED, False)], (0.2, np.pi / 3)),
        ([(n, (TURNED, LEVEL)[n % 2], False) for n in range(20)], (0, np.pi / 3)),
    ],
)
def test_mounts_that_two_publishers_tell_are_contradictions(told, expected):
    tree = TransformTree()
    for second, numbers, static in told:
        tree.add("base_link", "camera", second * 10**9, numbers, static=static)
    assert tree.contradiction("camera", begin=10.0) == pytest.approx(expected)


def test_of_two_parents_the_one_below_map_leads_unless_another_frame_is_named():
    tree = TransformTree()
    for i in range(20):
        tree.add("a_visual_odometry", "base_link", i * 10**8, (9, 0, 0, 0, 0, 0, 1))
        tree.add("vo", "base_link", i * 10**8, (7, 0, 0, 0, 0, 0, 1))
    for i in range(10):
        tree.add("wheels", "base_link", i * 10**8, (1, 0, 0, 0, 0, 0, 1))
        tree.add("map", "wheels", i * 10**8, (0, 0, 0, 0, 0, 0, 1))
    assert tree.ancestors("base_link") == ["base_link", "wheels", "map"]
    assert tree.other_parents(["base_link"]) == [
        ("base_link", "wheels", ["a_visual_odometry", "vo"])
    ]
    tree.lead("base_link", "vo")
    assert tree.ancestors("base_link") == ["base_link", "vo"]
    tree.lead("base_link", "map")
    assert tree.ancestors("base_link") == ["base_link", "wheels", "map"]
