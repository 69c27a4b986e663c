"""Bags of the room as robots record them, written message by message."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2

from perception.camera.poses import quaternion_from_pose
from perception.sources.listing import Streams
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import message_types, serialised
from tests.perception.conftest import SIZE, K, look_at, room_depth

BEGIN = 1_700_000_000  # [s]
#: pose of the camera on the robot: it looks ahead
MOUNT = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]])


def named(names: str, numbers: Any) -> dict[str, float]:
    return dict(zip(names, map(float, numbers), strict=True))


class Bag:
    """Writer of a bag by topics of one's own; fields that are left out are 0 or empty."""

    def __init__(self, path: Path, *, mcap: bool = True, ros1: bool = False) -> None:
        self.ros1, self.maker = ros1, MessageMaker(ros1)
        plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
        self.bag: Any = (
            rosbag1.Writer(path) if ros1 else rosbag2.Writer(path, version=8, storage_plugin=plugin)
        )
        self.connections: dict[str, Any] = {}
        self.now: float | None = None  # [s] when messages are recorded; by default at their stamps
        self.bag.open()

    def header(self, stamp: float, frame: str) -> dict[str, Any]:
        return self.maker.header(round(stamp * 1e9), frame)

    def write(self, topic: str, kind: str, stamp: float, **fields: Any) -> None:
        if topic not in self.connections:
            types = message_types(self.ros1)
            self.connections[topic] = self.bag.add_connection(topic, kind, typestore=types)
        data = serialised(kind, self.maker.make(kind, **fields), is_ros1=self.ros1)
        self.bag.write(self.connections[topic], round((self.now or stamp) * 1e9), data)

    def stamped(self, topic: str, kind: str, stamp: float, frame: str, **fields: Any) -> None:
        self.write(topic, kind, stamp, header=self.header(stamp, frame), **fields)

    def image(self, topic: str, stamp: float, array: NDArray[Any], encoding: str, frame: str,
              **changes: Any) -> None:  # fmt: skip
        data = np.ascontiguousarray(array).view(np.uint8).ravel()
        height, width, *_ = array.shape
        fields = {"height": height, "width": width, "encoding": encoding, "data": data}
        fields |= {"step": data.size // height} | changes
        self.stamped(topic, "sensor_msgs/msg/Image", stamp, frame, **fields)

    def compressed(self, topic: str, stamp: float, data: bytes, form: str, frame: str) -> None:
        content = np.frombuffer(data, np.uint8)
        kind = "sensor_msgs/msg/CompressedImage"
        self.stamped(topic, kind, stamp, frame, format=form, data=content)

    def camera(self, topic: str, stamp: float, frame: str, focal: float = K[0, 0]) -> None:
        k = K.copy()
        k[0, 0] = k[1, 1] = focal
        message = {"K" if self.ros1 else "k": k.ravel(), "height": SIZE[1], "width": SIZE[0]}
        self.stamped(topic, "sensor_msgs/msg/CameraInfo", stamp, frame, **message)

    def tf(self, topic: str, stamp: float, parent: str, child: str, T: NDArray[np.float64]) -> None:
        turned = named("xyzw", quaternion_from_pose(T))
        transform = {"translation": named("xyz", T[:3, 3]), "rotation": turned}
        one = {"header": self.header(stamp, parent), "child_frame_id": child}
        links = [one | {"transform": transform}]
        self.write(topic, "tf2_msgs/msg/TFMessage", stamp, transforms=links)

    def pose(self, topic: str, stamp: float, frame: str, T: NDArray[np.float64]) -> None:
        self.stamped(topic, "geometry_msgs/msg/PoseStamped", stamp, frame, pose=posed(T))

    def odometry(self, topic: str, stamp: float, child: str, T: NDArray[np.float64]) -> None:
        pose, kind = {"pose": posed(T)}, "nav_msgs/msg/Odometry"
        self.stamped(topic, kind, stamp, "odom", child_frame_id=child, pose=pose)

    def images(self, view: View, name: str = "/cam", frame: str = "lens") -> None:
        """Colour, depth and the camera of a view."""
        self.camera(f"{name}/camera_info", view.stamp, frame)
        self.image(f"{name}/image_raw", view.stamp, view.rgb, "rgb8", frame)
        self.image(f"{name}/depth/image_raw", view.stamp, view.depth, "16UC1", frame)


def rgbd_image(made: Bag, view: View, kind: str, **images: dict[str, Any]) -> None:
    """The camera's pose, and an RGBDImage of RTAB-Map with `images`, whose headers are left out."""
    header, k = made.header(view.stamp, "lens"), {"K" if made.ros1 else "k": K.ravel()}
    info = {"header": header, "height": SIZE[1], "width": SIZE[0], **k}
    images |= {"rgb_camera_info": info, "depth_camera_info": info}
    made.tf("/tf", view.stamp, "map", "lens", view.T)
    made.stamped("/rgbd_image", kind, view.stamp, "lens", **images)


def raw_image(array: NDArray[Any], encoding: str) -> dict[str, Any]:
    """Fields of an Image."""
    data = np.ascontiguousarray(array).view(np.uint8).ravel()
    fields = {"height": array.shape[0], "width": array.shape[1], "encoding": encoding}
    return {**fields, "step": data.size // array.shape[0], "data": data}


def posed(T: NDArray[np.float64]) -> dict[str, Any]:
    turned = named("xyzw", quaternion_from_pose(T))
    return {"position": named("xyz", T[:3, 3]), "orientation": turned}


class View(NamedTuple):
    """What the robot's camera sees at one moment."""

    number: int
    stamp: float  # [s]
    T: NDArray[np.float64]
    rgb: NDArray[np.uint8]
    depth: NDArray[Any]  # [mm]


def views() -> Iterator[View]:
    for i, angle in enumerate(np.linspace(0, 2, 6)):
        T = look_at((0.2 * i - 0.5, 0, 1.4), (2 * np.cos(angle), 2 * np.sin(angle), 0.7))
        rgb = np.full((SIZE[1], SIZE[0], 3), 40 * i, np.uint8)
        millimetres = np.round(room_depth(T, K, SIZE) * 1000).astype(np.uint16)
        yield View(i, BEGIN + i / 10, T, rgb, millimetres)


VIEWS = list(views())


def recorded(path: Path, add: Callable[[Bag, View], object], **options: Any) -> Path:
    """A bag of all views; `add` writes the messages of one."""
    made = Bag(path, **options)
    for view in views():
        add(made, view)
    made.bag.close()
    return path


def mapped(made: Bag, view: View) -> None:
    """The camera's pose in the map, and its images."""
    made.tf("/tf", view.stamp, "map", "lens", view.T)
    made.images(view)


def robot_bag(path, *, skip=(), raised=0.0, **options):
    """The room as a robot with odometry, a mounted camera and depth 5 ms late records it.

    The map frame is `raised` [m] below the floor.
    """

    def add(made: Bag, view: View) -> None:
        i, stamp, T, rgb, millimetres = view
        T[2, 3] += raised
        T_map_base = T @ np.linalg.inv(MOUNT)
        if i == 0 and "static" not in skip:
            made.tf("/tf_static", stamp, "base", "lens", MOUNT)
        if "tf" not in skip:
            made.tf("/tf", stamp, "odom", "base", T_map_base)
            made.tf("/tf", stamp, "map", "odom", np.eye(4))
        if "odometry" not in skip:
            made.odometry("/odom", stamp, "base", T_map_base)
        if "pose" not in skip:
            made.pose("/vslam/pose", stamp, "map", T)
        if "info" not in skip:
            made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb[:, :, ::-1], "bgr8", "lens")
        made.image("/cam/ir/image_raw", stamp, rgb[:, :, 0], "mono8", "lens")
        if "depth" not in skip:
            made.image("/cam/depth/image_raw", stamp + 0.005, millimetres, "16UC1", "lens")

    return recorded(path, add, **options)


def opened(path: Path, **streams: Any) -> FolderRecording:
    return open_recording(path, RecordingOptions(check=False, up="z", streams=Streams(**streams)))


def same_poses(read: FolderRecording) -> bool:
    return all(
        np.allclose(frame.T_map_cam, view.T, atol=0.03)
        for frame, view in zip(read.frames(), VIEWS, strict=True)
    )
