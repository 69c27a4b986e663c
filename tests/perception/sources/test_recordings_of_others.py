"""Bags that other robots record: poses that do not reach the camera, other clocks."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import BODY_FROM_CAMERA
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.conftest import SIZE, K

pytest.importorskip("rosbags")
from perception.sources.bags.bag_file import BagFile
from perception.sources.ros.message_types import message_types
from tests.perception.sources.bags.test_foreign_files import mcap
from tests.perception.sources.robot_bags import (
    MOUNT,
    VIEWS,
    Bag,
    View,
    opened,
    posed,
    recorded,
    robot_bag,
    same_poses,
)

# MOUNT as --camera-in has it: the camera looks ahead, so only its place is left
WHERE = "0.1,0,1.2,0,0,0"
NO_TF = ("tf", "static", "pose")


def test_odometry_that_nothing_links_to_the_camera_is_refused_until_its_mount_is_given(tmp_path):
    path = robot_bag(tmp_path / "robot", skip=NO_TF)
    with pytest.raises(RecordingError, match=r"poses of base, but none reach .* --camera-in base="):
        opened(path)
    assert same_poses(opened(path, camera_in=f"base={WHERE}"))
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(
        '<robot name="r"><joint name="mount" type="fixed"><parent link="base"/>'
        '<child link="lens"/><origin xyz="0.1 0 1.2" rpy="-1.5707963 0 -1.5707963"/></joint>'
        "</robot>"
    )
    assert same_poses(opened(path, camera_in=str(urdf)))
    with pytest.raises(RecordingError, match=r"is no mount; base_link=0.2,0,1.1,0,0,0 is one"):
        opened(path, camera_in="base=1,2,three")
    with pytest.raises(RecordingError, match=r"cannot read .*nowhere\.urdf"):
        opened(path, camera_in=str(tmp_path / "nowhere.urdf"))
    other = '<joint name="o" type="fixed"><parent link="a"/><child link="b"/></joint></robot>'
    turning = urdf.read_text().replace('"fixed"', '"revolute"').replace("</robot>", other)
    urdf.write_text(turning)
    with pytest.raises(RecordingError, match="a URDF with fixed joints from there to the camera"):
        opened(path, camera_in=str(urdf))
    urdf.write_text('<!DOCTYPE r [<!ENTITY a "a">]><robot>&a;</robot>')
    with pytest.raises(RecordingError, match="declares entities"):
        opened(path, camera_in=str(urdf))


def test_a_mount_is_the_pose_of_the_cameras_body() -> None:
    from perception.sources.bags.camera_mounts import mount

    assert np.allclose(mount(f"base={WHERE}") @ BODY_FROM_CAMERA, MOUNT)
    turned = mount("base=0,0,0,0.1,-0.2,0.3")
    roll, pitch = np.arctan2(turned[2, 1], turned[2, 2]), np.arcsin(-turned[2, 0])
    assert (roll, pitch) == pytest.approx((0.1, -0.2))
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.3)


def test_poses_of_a_frame_that_a_topic_does_not_name(tmp_path, caplog):
    def add(made: Bag, view: View) -> None:
        if not view.number:
            made.tf("/tf_static", view.stamp, "base", "lens", MOUNT)
        made.pose("/robot_pose", view.stamp, "map", view.T @ np.linalg.inv(MOUNT))
        made.pose("/goal_pose", view.stamp, "map", np.eye(4))
        made.images(view)

    path = recorded(tmp_path / "robot", add)
    assert same_poses(opened(path, pose_frame="base"))
    opened(path)
    assert "poses of /robot_pose are taken for those of lens; --pose-frame base if" in caplog.text


def test_each_robot_has_its_own_tree_and_its_own_images(tmp_path: Path) -> None:
    def add(made: Bag, view: View) -> None:
        near = view._replace(T=np.eye(4), depth=view.depth // 4)
        for name, seen in (("/a", view), ("/b", near)):
            if not view.number:
                made.tf(f"{name}/tf_static", view.stamp, "base", "lens", MOUNT)
            made.tf(f"{name}/tf", view.stamp, "odom", "base", seen.T @ np.linalg.inv(MOUNT))
            if name == "/a" or view.number:  # the other robot has fewer images
                made.images(seen, name)

    path = recorded(tmp_path / "robots", add)
    read = opened(path)
    assert same_poses(read)
    assert np.array_equal(np.nan_to_num(read.frame(2).depth * 1000).round(), VIEWS[2].depth)
    other = opened(path, colour="/b/image_raw")
    assert np.allclose(other.frame(0).T_map_cam[:3, :3], np.eye(3))


def rear_camera(made: Bag, view: View) -> None:
    """A camera with more images that no poses reach, beside one that they reach."""
    made.tf("/tf", view.stamp, "odom", "lens", view.T)
    made.images(view, "/front")
    for k in range(2):
        made.images(view._replace(stamp=view.stamp + k / 50), "/rear", "rear_lens")


def path_of_poses(made: Bag, view: View) -> None:
    """A path that grows."""
    header = made.header(view.stamp, "map")
    poses = [
        {"header": made.header(one.stamp, "map"), "pose": posed(one.T)}
        for one in VIEWS[: view.number + 1]
    ]
    made.write("/path", "nav_msgs/msg/Path", view.stamp, header=header, poses=poses)
    made.images(view)


def map_below(made: Bag, view: View) -> None:
    """A map frame that hangs below the camera."""
    made.tf("/tf_static", view.stamp, "base", "lens", MOUNT)
    made.tf("/tf", view.stamp, "base", "odom", MOUNT @ np.linalg.inv(view.T))
    made.images(view)


def linked(made: Bag, view: View, **changes: Any) -> None:
    """The camera's own pose in tf, and its images, with other `changes` of the view."""
    made.tf("/tf", view.stamp, "odom", "lens", view.T)
    made.images(view._replace(**changes))


def of_another_clock(first: float) -> Callable[[Bag, View], None]:
    """Stamps that begin at `first` [s], recorded now."""

    def add(made: Bag, view: View) -> None:
        made.now = view.stamp
        linked(made, view._replace(stamp=first + view.number))

    add.__name__ = f"from {first:g} s"
    return add


@pytest.mark.parametrize(
    "add", [rear_camera, path_of_poses, map_below, of_another_clock(0.0), of_another_clock(-2.0)]
)
def test_the_cameras_poses_are_found(tmp_path, caplog, add):
    assert same_poses(opened(recorded(tmp_path / "robot", add)))
    assert "started again" not in caplog.text


@pytest.mark.parametrize("moving", [True, False])
def test_the_frame_that_images_name_may_be_given(tmp_path: Path, moving: bool) -> None:
    def add(made: Bag, view: View) -> None:
        if moving:
            made.tf("/tf", view.stamp, "odom", "cam_optical", view.T)
        made.images(view, frame="")

    path = recorded(tmp_path / "robot", add)
    if moving:
        with pytest.raises(RecordingError, match="--camera-frame cam_optical names its frame"):
            opened(path)
        assert same_poses(opened(path, camera_frame="cam_optical"))
    else:
        with pytest.raises(RecordingError, match=r"has no poses of .* --poses FILE"):
            open_recording(path, RecordingOptions(check=False, estimate_poses=False))


def test_a_camera_that_stands_still_is_mapped_where_it_is_asked_for(tmp_path: Path) -> None:
    def add(made: Bag, view: View) -> None:
        made.tf("/tf_static", view.stamp, "base", "lens", MOUNT)
        made.images(view)

    path = recorded(tmp_path / "robot", add)
    with pytest.raises(RecordingError, match=r"tf does not move.*--map-frame base maps a camera"):
        open_recording(path, RecordingOptions(check=False, estimate_poses=False))
    still = opened(path, map_frame="base").frame(0)
    assert np.allclose(still.T_map_cam[:2, 3], MOUNT[:2, 3])


def test_a_camera_that_is_not_calibrated_names_what_is(tmp_path: Path) -> None:
    def add(made: Bag, view: View) -> None:
        linked(made, view)
        made.camera("/other/camera_info", view.stamp, "elsewhere")

    with BagFile(recorded(tmp_path / "robot", add)) as bag:
        raws = list(bag.messages({topic.name for topic in bag.topics}))
    types = message_types(False)

    def blank(raw: Any) -> bytes:
        if raw.topic != "/cam/camera_info":
            return bytes(raw.data)
        message = types.deserialize_cdr(raw.data, raw.type)
        return bytes(types.serialize_cdr(replace(message, k=np.zeros(9)), raw.type))

    path = mcap(tmp_path / "k.mcap", raws, blank)
    with pytest.raises(RecordingError, match=r"has K = 0; .*FILE, --info-topic /other/camera_info"):
        opened(path)
    assert same_poses(opened(path, camera="/other/camera_info"))
    given = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *SIZE, source="given")
    assert same_poses(open_recording(path, RecordingOptions(check=False, up="z", intrinsics=given)))


def test_a_camera_that_is_mounted_upside_down_is_turned(tmp_path, caplog):
    def add(made: Bag, view: View) -> None:
        made.tf("/tf", view.stamp, "odom", "lens", view.T @ np.diag([-1.0, -1.0, 1.0, 1.0]))
        made.images(view._replace(rgb=view.rgb[::-1, ::-1], depth=view.depth[::-1, ::-1]))

    read = opened(recorded(tmp_path / "robot", add))
    assert "turned by 180 degrees" in caplog.text
    assert same_poses(read)
    assert np.array_equal(np.nan_to_num(read.frame(2).depth * 1000).round(), VIEWS[2].depth)
    moved = [SIZE[0] - 1 - K[0, 2], SIZE[1] - 1 - K[1, 2]]
    assert read.frame(2).K[:2, 2].tolist() == moved


def test_a_world_whose_z_is_not_up_is_refused_with_the_direction(tmp_path: Path) -> None:
    first = np.linalg.inv(VIEWS[0].T)

    def add(made: Bag, view: View) -> None:
        made.tf("/tf", view.stamp, "world", "lens", first @ view.T)
        made.images(view)

    path = recorded(tmp_path / "robot", add)
    wanted = r"--up -?0\.\d+,-0\.9\d+,-0\.\d+ would work"
    with pytest.raises(RecordingError, match=wanted) as refused:
        open_recording(path)
    up = str(refused.value).split("--up ")[1].split(" ")[0]
    read = open_recording(path, RecordingOptions(up=up))
    assert np.allclose(read.frame(3).T_map_cam[2], VIEWS[3].T[2], atol=0.05)


def test_the_last_run_of_a_simulation_counts(tmp_path, caplog):
    made = Bag(tmp_path / "robot.bag", ros1=True)
    for run in range(2):
        for view in VIEWS:
            place = view.T.copy()
            place[0, 3] += 1 - run
            made.now = view.stamp + run  # recorded later, with the stamps of the first run
            made.tf("/tf", 5.0 + view.number, "odom", "lens", place)
            made.images(view._replace(stamp=5.0 + view.number))
    made.bag.close()
    read = opened(tmp_path / "robot.bag")
    assert "started again" in caplog.text
    assert same_poses(read)


def test_images_of_video_are_no_colour_images_and_are_named(tmp_path: Path) -> None:
    def add(made: Bag, view: View) -> None:
        made.tf("/tf", view.stamp, "map", "lens", view.T)
        made.camera("/cam/rgb/camera_info", view.stamp, "lens")
        made.compressed("/cam/rgb/image_raw/compressed", view.stamp, bytes(600), "h264", "lens")
        made.image("/cam/depth/image_raw", view.stamp, view.depth, "16UC1", "lens")

    with pytest.raises(RecordingError, match=r"no colour images, but /cam/rgb.* video .*republish"):
        opened(recorded(tmp_path / "robot", add))


@pytest.mark.parametrize("clock", [5000.0, 1.0])
def test_up_of_estimated_poses_is_that_of_floor_and_walls_where_given_poses_turn_otherwise(
    shared: Callable[[str], Path], tmp_path: Path, clock: float
) -> None:
    """By another clock, or those of a head whose robot moves."""
    room = open_recording(
        shared("data/rgbd/icl_livingroom"), RecordingOptions(selection=Selection(every=4, limit=14))
    )
    made = Bag(tmp_path / "robot")
    for i, frame in enumerate(room.frames()):
        made.tf("/tf", clock + i, "map", "lens", frame.T_map_cam if clock > 1 else np.eye(4))
        made.image("/cam/rgb/image_raw", 1.0 + i, frame.rgb, "rgb8", "lens")
        made.image("/cam/depth/image_raw", 1.0 + i, frame.depth, "32FC1", "lens")
    made.bag.close()
    options = RecordingOptions(intrinsics=room.rectifier.camera, estimate_poses=True)
    read = open_recording(tmp_path / "robot", options)
    # heights of the camera's axes
    assert read.frame(0).T_map_cam[2, :3] @ room.frame(0).T_map_cam[2, :3] > np.cos(np.radians(3))
