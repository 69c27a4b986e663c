"""Choice of a bag's topics of colour, depth, camera and poses, where the user names none.

Colour: images of a colour encoding, before grey ones; before others those with `color` or `rgb` in
their name, then those with a CameraInfo, then the most messages. Depth: images of a depth encoding;
before others those in colour's frame, then those with `aligned` or `registered` in their name, then
`depth`, then the most messages. CameraInfo: in the image's namespace, else of the image's frame.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final

from kg.model.errors import RecordingError, did_you_mean
from perception.sources.bags.bag_index import CAMERA, IMAGES, ODOMETRY, POSES, BagIndex, Stream

_TRANSPORTS: Final = ("compressed", "compressedDepth", "theora")
_COLOUR: Final = re.compile("colou?r|rgb")
_REGISTERED: Final = re.compile("aligned|registered|hw_registered")
_OTHER: Final = re.compile("disparity|confidence|label|mask|infra|/ir/|debug|detection|overlay")
MAP_FRAMES: Final = ("map", "world", "odom")


def colour_topic(index: BagIndex, given: str | None) -> Stream:
    """Stream of the colour images; raises RecordingError where there is none."""
    if given is not None:
        return _given(index, given, IMAGES, "--color-topic")

    def rank(stream: Stream) -> tuple[Any, ...]:
        kind = stream.kind
        assert kind is not None
        return (
            not _OTHER.search(stream.topic),
            not kind.encoding.startswith(("mono", "8UC1")),
            bool(_COLOUR.search(stream.topic)),
            camera_topic(index, stream) is not None,
            len(stream.stamps),
        )

    found = [s for s in _images(index) if s.kind is not None and not s.kind.is_depth]
    found = [s for s in found if "depth" not in s.topic]
    return _best(found, rank, index, "colour images", "--color-topic")


def depth_topic(index: BagIndex, given: str | None, colour: Stream) -> Stream:
    """Stream of the depth images; raises RecordingError where there is none."""
    if given is not None:
        return _given(index, given, IMAGES, "--depth-topic")

    def rank(stream: Stream) -> tuple[Any, ...]:
        return (
            not _OTHER.search(stream.topic),
            stream.frame == colour.frame,
            bool(_REGISTERED.search(stream.topic)),
            "depth" in stream.topic,
            len(stream.stamps),
        )

    found = [s for s in _images(index) if s.kind is not None and s is not colour]
    found = [
        s
        for s in found
        if s.kind is not None
        and (s.kind.is_depth or ("depth" in s.topic and s.kind.compression == "png"))
    ]
    return _best(found, rank, index, "depth images", "--depth-topic")


def camera_topic(index: BagIndex, images: Stream, given: str | None = None) -> Stream | None:
    """Stream of the CameraInfo of an image stream; None where there is none."""
    if given is not None:
        return _given(index, given, (CAMERA,), "--info-topic")
    parts = images.topic.split("/")
    if parts[-1] in _TRANSPORTS:
        parts = parts[:-1]
    beside = index.streams.get("/".join([*parts[:-1], "camera_info"]))
    if beside is not None and beside.type == CAMERA:
        return beside
    of_frame = [s for s in index.streams.values() if s.type == CAMERA and s.frame == images.frame]
    return max(of_frame, key=lambda s: (len(s.stamps), s.topic), default=None)


def pose_topic(index: BagIndex, given: str | None) -> Stream | None:
    """Stream of the poses that are not tf: the given one, else odometry, else the most messages."""
    if given is not None:
        return _given(index, given, (ODOMETRY, *POSES), "--pose-topic")
    found = [index.streams[topic] for topic in index.poses]
    return max(found, key=lambda s: (s.type == ODOMETRY, len(s.stamps), s.topic), default=None)


def map_frame(index: BagIndex, camera: str, given: str | None) -> str:
    """Frame that poses are taken in: map, world or odom, where it carries the camera; or the root.

    Raises RecordingError where transforms form a loop.
    """
    if given is not None:
        return given.lstrip("/")
    above = index.tree.ancestors(camera)
    return next((frame for frame in MAP_FRAMES if frame in above[1:]), above[-1])


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
            f"{index.path} has no {what}; image topics are: {images} ({option} names one)"
        )
    return max(sorted(found, key=lambda s: s.topic, reverse=True), key=rank)
