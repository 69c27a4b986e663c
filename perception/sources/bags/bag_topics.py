"""Choice of a bag's topics of colour, depth and camera, where the user names none.

Colour: images whose camera poses reach; of a colour encoding, before grey ones; before others those
with `color` or `rgb` in their name, then those with a CameraInfo, then the most messages. Depth:
images of a depth encoding, of colour's robot; before others those in colour's frame, then those in
its namespace, then those with `aligned` or `registered` in their name, then `depth`, then the most
messages. CameraInfo: in the image's namespace, else of the image's frame.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import takewhile
from typing import Any, Final

from kg.model.errors import RecordingError, did_you_mean
from perception.sources.bags.bag_index import CAMERA, IMAGES, BagIndex, Stream
from perception.sources.bags.bag_poses import POSE_TYPES, reaches
from perception.sources.listing import Streams
from perception.sources.ros.image_messages import frame_name, is_calibrated

_TRANSPORTS: Final = ("compressed", "compressedDepth", "theora")
_COLOUR: Final = re.compile("colou?r|rgb")
_REGISTERED: Final = re.compile("aligned|registered|hw_registered")
_PICTURES: Final = "colour images"
_DEPTH: Final = "depth images"
#: topics and types that are not read, the images sought in them, and what would work
_UNREAD: Final = (
    (re.compile("[Vv]ideo|Packet"), _PICTURES, "video is not decoded here; `ros2 run "
     "image_transport republish` makes images of it, to be recorded anew"),
    (re.compile("DisparityImage"), _DEPTH, "stereo_image_proc or the camera's driver makes depth "
     "images of them, to be recorded anew"),
    (re.compile("PointCloud2"), _DEPTH, "clouds are not read; the depth image that the camera's "
     "driver publishes beside would work"),
)  # fmt: skip
_OTHER: Final = re.compile("disparity|confidence|label|mask|infra|/ir/|debug|detection|overlay")


def colour_topic(index: BagIndex, streams: Streams) -> Stream:
    """Stream of the colour images; raises RecordingError where there is none."""
    if streams.colour is not None:
        return framed(_given(index, streams.colour, IMAGES, "--color-topic"), streams)

    def rank(stream: Stream) -> tuple[Any, ...]:
        kind = stream.kind
        assert kind is not None
        return (
            not _OTHER.search(stream.topic),
            len(found) > 1 and reaches(index, stream, streams),
            not kind.encoding.startswith(("mono", "8UC1")),
            bool(_COLOUR.search(stream.topic)),
            camera_topic(index, stream) is not None,
            len(stream.stamps),
        )

    found = [s for s in _images(index) if s.kind is not None and not s.kind.is_depth]
    found = [s for s in found if s.kind is not None and s.kind.compression != "video"]
    found = [framed(s, streams) for s in found if "depth" not in s.topic.rpartition("depth_to_")[2]]
    return _best(found, rank, index, _PICTURES, "--color-topic")


def framed(images: Stream, streams: Streams) -> Stream:
    """The colour images in the frame that the user gives their camera."""
    given = streams.camera_frame
    return images if given is None else replace(images, frame=frame_name(given))


def depth_topic(index: BagIndex, given: str | None, colour: Stream) -> Stream:
    """Stream of the depth images; raises RecordingError where there is none."""
    if given is not None:
        return _given(index, given, IMAGES, "--depth-topic")

    def rank(stream: Stream) -> tuple[Any, ...]:
        return (
            index.robot(stream.topic) == index.robot(colour.topic),
            not _OTHER.search(stream.topic),
            stream.frame == index.streams[colour.topic].frame,
            _common(stream.topic, colour.topic),
            bool(_REGISTERED.search(stream.topic)),
            "depth" in stream.topic,
            len(stream.stamps),
        )

    found = [s for s in _images(index) if s.kind is not None and s.topic != colour.topic]
    found = [
        s
        for s in found
        if s.kind is not None
        and (s.kind.is_depth or ("depth" in s.topic and s.kind.compression in ("png", "rvl")))
    ]
    return _best(found, rank, index, _DEPTH, "--depth-topic")


def _common(topic: str, other: str) -> int:
    """Number of names that both topics begin with."""
    pairs = zip(topic.split("/"), other.split("/"), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def camera_topic(index: BagIndex, images: Stream, given: str | None = None) -> Stream | None:
    """Stream of the CameraInfo of an image stream; None where there is none."""
    if given is not None:
        return _given(index, given, (CAMERA,), "--info-topic")
    frame = index.streams[images.topic].frame
    parts = images.topic.split("/")
    if parts[-1] in _TRANSPORTS:
        parts = parts[:-1]
    beside = index.streams.get("/".join([*parts[:-1], "camera_info"]))
    if beside is not None and beside.type == CAMERA:
        return beside
    of_frame = [s for s in cameras(index, images.topic) if s.frame == frame]
    return max(of_frame, key=lambda s: (len(s.stamps), s.topic), default=None)


def cameras(index: BagIndex, topic: str) -> list[Stream]:
    """Streams of CameraInfo of a topic's robot that are calibrated; else all of the robot's."""
    robot = index.robot(topic)
    found = [s for s in index.streams.values() if s.type == CAMERA]
    found = [s for s in found if index.robot(s.topic) == robot]
    return [s for s in found if is_calibrated(s.first)] or found


def check_pose_topic(index: BagIndex, given: str | None) -> None:
    """Raise RecordingError where the user names a topic of poses that there is not."""
    if given is not None:
        _given(index, given, POSE_TYPES, "--pose-topic")


def _images(index: BagIndex) -> list[Stream]:
    return [stream for stream in index.streams.values() if stream.type in IMAGES]


def _given(index: BagIndex, topic: str, types: tuple[str, ...], option: str) -> Stream:
    stream = index.streams.get(topic)
    if stream is not None and stream.type in types:
        return stream
    known = sorted(s.topic for s in index.streams.values() if s.type in types)
    close = did_you_mean(topic, known)
    raise RecordingError(
        f"{index.path}: {option} {topic!r} is no topic of its kind{close}; there are: "
        f"{', '.join(known) or 'none'}"
    )


def _best(
    found: list[Stream],
    rank: Callable[[Stream], tuple[Any, ...]],
    index: BagIndex,
    what: str,
    option: str,
) -> Stream:
    if not found:
        images = ", ".join(sorted(s.topic for s in _images(index))) or "none"
        raise RecordingError(
            f"{index.path} has no {what}{_unread(index, what)}; image topics are: {images} "
            f"({option} names one)"
        )
    return max(sorted(found, key=lambda s: s.topic, reverse=True), key=rank)


def _unread(index: BagIndex, what: str) -> str:
    """Topics that may hold the images sought in a form that is not read, and what would work."""
    types = {topic: kind for topic, (kind, _) in index.others.items()}
    types |= {s.topic: "video" for s in _images(index) if s.kind and s.kind.compression == "video"}
    for like, wanted, advice in _UNREAD:
        found = [f"{t} ({kind})" for t, kind in types.items() if like.search(f"{t} {kind}")]
        if found and wanted == what:
            return f", but {', '.join(found[:3])}: {advice}"
    return ""
