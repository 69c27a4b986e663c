"""Summary of a recording: its streams, with rates, gaps and use."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception.sources.bags.bag import Choice
from perception.sources.bags.bag_index import TRANSFORMS, BagIndex, Stream
from perception.sources.listing import FRAME_RATE, FrameEntry, stamp_of_number


@dataclass(frozen=True, slots=True)
class StreamSummary:
    """A stream of a recording."""

    name: str
    holds: str  # its messages' type, with encoding and size of images
    count: int
    rate: float | None  # [Hz] median; None: fewer than two stamps
    gap: float | None  # [s] longest between two stamps
    frame: str
    use: str  # "colour", "depth", ...; "" where it is not read

    def to_json(self) -> dict[str, Any]:
        """The fields by name."""
        return asdict(self)


def bag_streams(index: BagIndex, choice: Choice | None) -> list[StreamSummary]:
    """All topics of a bag; topics other than images, cameras and poses have a count alone."""
    uses = _uses(index, choice)
    known = [
        _summary(s.topic, _holds(s), s.seconds, s.frame, uses.get(s.topic, ""))
        for s in index.streams.values()
    ]
    others = [
        StreamSummary(topic, kind, count, None, None, "", "")
        for topic, (kind, count) in index.others.items()
    ]
    return sorted([*known, *others], key=lambda one: (not one.use, one.name))


def file_streams(entries: tuple[FrameEntry, ...], size: tuple[int, int]) -> list[StreamSummary]:
    """Streams of a recording that is a folder of images."""
    stamps = np.array([entry.stamp for entry in entries])
    images = f"images {size[0]}x{size[1]}"
    numbered = all(stamp == stamp_of_number(round(stamp * FRAME_RATE)) for stamp in stamps)
    if numbered and any(stamp != round(stamp, 3) for stamp in stamps):
        images += f", no stamps: {FRAME_RATE:g} a second are taken"
    return [
        _summary("colour", images, stamps, "", "colour"),
        _summary("depth", "images", stamps, "", "depth"),
        _summary("poses", "camera poses", stamps, "", "poses"),
    ]


def _uses(index: BagIndex, choice: Choice | None) -> dict[str, str]:
    if choice is None:
        return {}
    uses = {choice.colour.topic: "colour", choice.depth.topic: "depth"}
    if choice.camera is not None:
        uses[choice.camera.topic] = "camera"
    if choice.depth_apart and choice.depth_camera is not None:
        uses[choice.depth_camera.topic] = "depth camera"
    poses = [topic for topic, stream in index.streams.items() if stream.type in TRANSFORMS]
    if choice.pose_topic is not None:
        poses.append(choice.pose_topic.topic)
    return uses | dict.fromkeys(poses, "poses")


def _holds(stream: Stream) -> str:
    kind = stream.kind
    if kind is None:
        return stream.type.replace("/msg/", "/")
    size = "" if kind.size is None else f" {kind.size[0]}x{kind.size[1]}"
    return f"{kind.encoding} {kind.compression}".strip() + size


def _summary(
    name: str, holds: str, stamps: NDArray[np.float64], frame: str, use: str
) -> StreamSummary:
    steps = np.diff(np.sort(stamps))
    middle = float(np.median(steps)) if len(steps) else 0.0
    rate = 1 / middle if middle > 0 else None
    return StreamSummary(
        name, holds, len(stamps), rate, float(steps.max()) if len(steps) else None, frame, use
    )
