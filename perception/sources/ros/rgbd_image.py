"""RGBDImage of RTAB-Map: colour, depth and both cameras in one message, taken apart.

Its parts are messages of their own, on the topics on which RTAB-Map's rgbd_split publishes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from perception.sources.ros.image_messages import nanoseconds
from perception.sources.ros.message_types import RGBD_IMAGES, RGBD_PARTS, leading, serialised

_CAMERA: Final = "sensor_msgs/msg/CameraInfo"
_IMAGE: Final = "sensor_msgs/msg/Image"
_COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
#: fields, of which the first with pixels counts, and their types, by the topic below that of all
_PARTS: Final[dict[str, dict[str, str]]] = {
    "rgb/camera_info": {"rgb_camera_info": _CAMERA},
    "rgb/image": {"rgb": _IMAGE, "rgb_compressed": _COMPRESSED},
    "depth/camera_info": {"depth_camera_info": _CAMERA},
    "depth/image": {"depth": _IMAGE, "depth_compressed": _COMPRESSED},
}


def whole_by_part(types: Mapping[str, str]) -> dict[str, str]:
    """Topics of the parts of RGBDImages among topics of `types`, and the topic of the whole.

    A part that is a topic itself is no part.
    """
    images = [topic for topic, kind in types.items() if kind in RGBD_IMAGES]
    found = {f"{topic}/{part}": topic for topic in images for part in _PARTS}
    return {part: topic for part, topic in found.items() if part not in types}


def type_of_part(topic: str) -> str:
    """Type of the messages of a part; of images that of raw ones."""
    return next(iter(_PARTS["/".join(topic.split("/")[-2:])].values()))


def parts(topic: str, data: bytes, *, is_ros1: bool) -> Iterator[tuple[str, str, bytes]]:
    """Topic, type and content of each part of an RGBDImage.

    A part without a stamp or a frame has those of the whole.
    """
    whole = leading(RGBD_PARTS, data, is_ros1=is_ros1)
    for below, kinds in _PARTS.items():
        for name, kind in kinds.items():
            part: Any = getattr(whole, name)
            if kind != _CAMERA and not len(part.data):
                continue
            if not nanoseconds(part.header) or not part.header.frame_id:
                part = replace(part, header=whole.header)
            yield f"{topic}/{below}", kind, serialised(kind, part, is_ros1=is_ros1)
            break
