"""Writer of bags: frames in, a ROS 1 bag, a ROS 2 bag or an MCAP file out.

Images are kept to the last bit (`perception.sources.ros.message_maker`). Topics are called as
camera drivers call them; poses are transforms of the camera's optical frame in `world`, and `world`
in `map`, which has z up. ROS has no message for the names of frames and for the transform of the
world into the map; one string of JSON on a topic of its own holds both.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from kg.model.errors import RecordingError
from perception.camera.poses import Pose
from perception.frames import Frame
from perception.sources.bags.bag_index import MIN_TIME, NOTE_TOPIC
from perception.sources.recording import FolderRecording
from perception.sources.ros.image_messages import NANOSECONDS
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import message_types, serialised

WORLD: Final = "world"
MAP: Final = "map"
CAMERA: Final = "camera_color_optical_frame"
COLOUR: Final = "/camera/color/image_raw/compressed"
COLOUR_INFO: Final = "/camera/color/camera_info"
DEPTH: Final = "/camera/aligned_depth_to_color/image_raw"
DEPTH_INFO: Final = "/camera/aligned_depth_to_color/camera_info"
#: topic -> type
IMAGE_TOPICS: Final = {
    COLOUR_INFO: "sensor_msgs/msg/CameraInfo",
    COLOUR: "sensor_msgs/msg/CompressedImage",
    DEPTH_INFO: "sensor_msgs/msg/CameraInfo",
    DEPTH: "sensor_msgs/msg/Image",
}
_TOPICS: Final = {
    NOTE_TOPIC: "std_msgs/msg/String",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    **IMAGE_TOPICS,
}
_ENDINGS: Final = ("", ".bag", ".mcap")
_LATCHED: Final = (NOTE_TOPIC, "/tf_static")


def write_bag(recording: FolderRecording, path: Path) -> Iterator[Frame]:
    """Write a recording to `path`, and yield each frame that is written.

    `path` ends with .bag (ROS 1) or .mcap; without an ending it is a ROS 2 bag, a folder with
    SQLite. It exists only once everything is written. Raises RecordingError for another ending,
    and where `path` exists or cannot be written.
    """
    if path.suffix not in _ENDINGS:
        raise RecordingError(
            f"cannot write {path}: unknown ending {path.suffix!r}; .mcap (ROS 2), .bag (ROS 1) or "
            f"no ending (folder of a ROS 2 bag) would work"
        )
    if path.exists():
        raise RecordingError(f"{path} exists already; a new name would work")
    if not path.parent.is_dir():
        raise RecordingError(f"cannot write {path}: there is no folder {path.parent}")
    entries = recording.listing.entries
    with _new(path) as unfinished, _Writer(unfinished) as writer:
        writer.begin(recording, _nanoseconds(entries[0].stamp))
        for entry, frame in zip(entries, recording.frames(), strict=True):
            writer.add(frame, _nanoseconds(entry.stamp), entry.T_world_cam)
            yield frame


def _nanoseconds(stamp: float) -> int:
    """Whole nanoseconds of a stamp [s]; divided by 10^9 they give it back."""
    numerator, denominator = float(stamp).as_integer_ratio()
    return (2 * numerator * NANOSECONDS + denominator) // (2 * denominator)


@contextmanager
def _new(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to, which takes its place at the end."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error
    try:
        yield folder / path.name
        written = folder / path.name
        if path.suffix == ".mcap":  # rosbags writes a folder with the file in it
            written = next(written.glob("*.mcap"))
        written.rename(path)
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Writer:
    """Messages of frames, serialised into a bag."""

    def __init__(self, path: Path) -> None:
        try:
            from rosbags import rosbag1, rosbag2
        except ImportError as error:
            raise RecordingError(
                f"writing {path.name} needs the package rosbags: pip install 'hereabouts[ros]'"
            ) from error
        self._is_ros1 = path.suffix == ".bag"
        self._types = message_types(self._is_ros1)
        self._maker = MessageMaker(self._is_ros1)
        self._bag: Any
        if self._is_ros1:
            self._bag = rosbag1.Writer(path)
        else:
            mcap = path.suffix == ".mcap"
            plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
            self._bag = rosbag2.Writer(path, version=8, storage_plugin=plugin)
            if mcap:
                self._bag.set_compression(
                    rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD
                )

    def __enter__(self) -> _Writer:
        self._bag.open()
        self._connections = {
            topic: self._bag.add_connection(
                topic, kind, typestore=self._types, **self._latched(topic in _LATCHED)
            )
            for topic, kind in _TOPICS.items()
        }
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._bag.close()
        else:
            self._bag.abort()

    def _latched(self, latched: bool) -> dict[str, Any]:
        if not latched:
            return {}
        if self._is_ros1:
            return {"latching": 1}
        from rosbags import interfaces as ros

        ever = ros.QosTime(2147483647, 4294967295)
        kept: tuple[Any, ...] = ros.QosHistory.KEEP_LAST, 1, ros.QosReliability.RELIABLE
        kept += ros.QosDurability.TRANSIENT_LOCAL, ever, ever, ros.QosLiveliness.AUTOMATIC
        return {"offered_qos_profiles": [ros.Qos(*(*kept, ever, False))]}

    def begin(self, recording: FolderRecording, stamp: int) -> None:
        """Write the messages that hold for the whole recording."""
        note = {
            "frame": WORLD,
            "T_map_world": [float(x) for x in recording.T_map_world.ravel()],
            "frames": [entry.id for entry in recording.listing.entries],
        }
        self._write(
            NOTE_TOPIC, stamp, self._maker.make("std_msgs/msg/String", data=json.dumps(note))
        )
        levelled = self._maker.transforms(stamp, MAP, WORLD, recording.T_map_world)
        self._write("/tf_static", stamp, levelled)

    def add(self, frame: Frame, stamp: int, T_world_cam: Pose) -> None:
        """Write one frame."""
        make = self._maker
        header = make.header(stamp, CAMERA)
        self._write("/tf", stamp, make.transforms(stamp, WORLD, CAMERA, T_world_cam))
        for topic in (COLOUR_INFO, DEPTH_INFO):
            self._write(topic, stamp, make.camera_info(frame.K, frame.depth.shape, header))
        self._write(COLOUR, stamp, make.colour(frame, header))
        self._write(DEPTH, stamp, make.depth(frame.depth, header))
        make.number += 1

    def _write(self, topic: str, stamp: int, message: Any) -> None:
        time = max(stamp, MIN_TIME)
        data = serialised(_TOPICS[topic], message, is_ros1=self._is_ros1)
        self._bag.write(self._connections[topic], time, data)
