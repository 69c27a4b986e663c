"""An extension of hereabouts: .npz files, a detector of red things, CSV, a bag, a robot."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from hereabouts import (
    Detections,
    Exporter,
    Frame,
    FrameEntry,
    Intrinsics,
    RecordingError,
    RecordingFormat,
    RecordingListing,
    SemanticMap,
)

# a recording format


@dataclass(frozen=True)
class Image:
    """An image of a recording; a format may also decode it from disk only when it is asked for."""

    pixels: np.ndarray  # (H, W, 3) uint8 RGB, or (H, W) [m] depth

    def check(self) -> None:
        """Raise RecordingError for a damaged file, as far as that shows without decoding."""

    def colour(self) -> np.ndarray:
        return self.pixels

    def depth(self, depth_scale: float) -> np.ndarray:
        return np.where(self.pixels > 0, self.pixels, np.nan).astype(np.float32)


def read(path: Path, streams: object) -> RecordingListing:
    """All frames of a file with the arrays rgb, depth, K, T_world_cam and stamps."""
    try:
        with np.load(path) as file:
            arrays = [file[name] for name in ("rgb", "depth", "T_world_cam", "stamps")]
            K = file["K"]
    except (OSError, KeyError, ValueError) as error:
        raise RecordingError(f"{path} is no recording: {error}") from error
    entries = [
        FrameEntry(f"{n:06d}", Image(rgb), Image(depth), T_world_cam, float(stamp))
        for n, (rgb, depth, T_world_cam, stamp) in enumerate(zip(*arrays, strict=True))
    ]
    camera = Intrinsics(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2])
    return RecordingListing(tuple(entries), camera, depth_scale=1.0)


NPZ = RecordingFormat(
    name="npz",
    looks_for="a .npz file",
    matches=lambda path: path.suffix == ".npz",
    read=read,
)


# a detector


class RedThings:
    """Finds the red pixels of an image, as one pillar."""

    name = "red-things"

    def __init__(self, *, threshold: float, device: str) -> None:
        self.threshold = threshold

    def detect(self, frame: Frame) -> Detections:
        red, green, blue = np.moveaxis(frame.rgb.astype(int), 2, 0)
        rows, columns = np.nonzero((red > 150) & (green < 80) & (blue < 80))
        if len(rows) < 20:
            return Detections(np.empty((0, 4), np.float32), np.empty(0, np.float32), ())
        box = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
        area = (box[2] - box[0]) * (box[3] - box[1])
        score = len(rows) / area
        if score < self.threshold:
            return Detections(np.empty((0, 4), np.float32), np.empty(0, np.float32), ())
        return Detections(np.array([box], np.float32), np.array([score], np.float32), ("pillar",))


# an exporter


def write_csv(semantic_map: SemanticMap, path: Path) -> str:
    """The rows of the query `objects` as CSV."""
    table = semantic_map.query("objects")
    path.write_text(table.to_csv(), encoding="utf-8")
    return f"{len(table.rows)} objects"


CSV = Exporter(ending=".csv", write=write_csv)


# a live connection


class PlayedBag:
    """The messages of a ROS 2 bag, as played://FOLDER."""

    def __init__(self, address: str) -> None:
        self.path = Path(address.partition("://")[2])

    def run(self, wanted, offer, ended: threading.Event) -> None:
        with AnyReader([self.path]) as bag:
            topics = wanted({one.topic: one.msgtype for one in bag.connections})
            for one, time, data in bag.messages():
                topics |= wanted({one.topic: one.msgtype})
                if ended.wait(0.01):
                    return
                if one.topic in topics:
                    offer(one.topic, one.msgtype, time, data)


# a robot


class Oracle:
    """A robot, as oracle://X,Y, that is wherever it is sent, and sees a pillar at (X, Y)."""

    def __init__(self, address: str) -> None:
        self.x, self.y = map(float, address.partition("://")[2].split(","))
        self.messages: list[dict] = []

    def send(self, command: dict) -> None:
        if command["type"] == "hello":
            pose = {"type": "pose", "x": 0.0, "y": 0.0, "heading": 0.0}
            self.messages += [{"type": "hello", "protocol": 1, "name": "oracle"}, pose]
        elif command["type"] == "goto":
            pose = {key: command[key] for key in ("x", "y", "heading")}
            self.messages += [{"type": "pose", **pose}, {"type": "arrived", "id": command["id"]}]
        elif command["type"] == "look":
            pillar = {"label": "pillar", "score": 0.9, "x": self.x, "y": self.y, "z": 0.5}
            answer = {"type": "detections", "id": command["id"], "objects": [pillar]}
            self.messages.append(answer)

    def receive(self, seconds: float) -> dict | None:
        return self.messages.pop(0) if self.messages else None

    def close(self) -> None:
        self.messages.clear()
