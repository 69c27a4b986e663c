"""RGBDImage of RTAB-Map: colour, depth and both cameras in one message, taken apart.

Its parts are messages of their own, on the topics on which RTAB-Map's rgbd_split publishes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from perception.sources.ros.image_messages import nanoseconds
from perception.sources.ros.message_types import RGBD_IMAGES, leading, serialised

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


def wholes(types: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Topics of the parts of RGBDImages among topics of `types`: topic of the whole, and type.

    A part that is a topic itself is no part. Images have the type of raw ones.
    """
    images = [topic for topic, kind in types.items() if kind in RGBD_IMAGES]
    found = {
        f"{t}/{part}": (t, next(iter(of.values()))) for t in images for part, of in _PARTS.items()
    }
    return {part: whole for part, whole in found.items() if part not in types}


def parts(topic: str, data: bytes, *, is_ros1: bool) -> Iterator[tuple[str, str, bytes]]:
    """Topic, type and content of each part of an RGBDImage.

    A part without a stamp or a frame has those of the whole.
    """
    whole = leading(RGBD_IMAGES[0], data, is_ros1=is_ros1)
    for below, kinds in _PARTS.items():
        for name, kind in kinds.items():
            part: Any = getattr(whole, name)
            if kind != _CAMERA and not len(part.data):
                continue
            if not nanoseconds(part.header) or not part.header.frame_id:
                part = replace(part, header=whole.header)
            yield f"{topic}/{below}", kind, serialised(kind, part, is_ros1=is_ros1)
            break
