"""Detections that another program publishes, instead of a network: of vision_msgs, or yolo_msgs.

A Detection2DArray is in pixels of the colour image whose stamp it has. Of a Detection3DArray, each
box counts as its outline in the image. Each detection has its best hypothesis alone. The
DetectionArray of yolo_msgs has outlines of masks, too.
"""

from __future__ import annotations

import itertools
import logging
import math
import threading
from collections import OrderedDict
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Rectifier
from perception.camera.poses import Pose, pose_from_quaternion
from perception.frames import Detections, Frame

BOXES: Final = "vision_msgs/msg/Detection2DArray"
SOLIDS: Final = "vision_msgs/msg/Detection3DArray"
MASKS: Final = "yolo_msgs/msg/DetectionArray"
TYPES: Final = (BOXES, SOLIDS, MASKS)
SAME: Final = 1_000_000  # [ns] between the stamps of an image and of its detections
KEPT: Final = 200  # messages, and frames
MAX_DETECTIONS: Final = 300  # of a frame; the best are kept
NEAR: Final = 0.05  # [m] from the camera, before which a box has no outline
_NO_MASK: Final = SimpleNamespace(data=())
_CORNERS: Final = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))

_log = logging.getLogger(__name__)


CAMERA: Final = "{camera}"  # in a topic: the name of the camera, where there are several


class TopicDetector:
    """A `Detector` of the detections that come on a topic; a `FrameStream` passes them on.

    Frames without a message of the same stamp are not mapped, since they would count as views that
    show nothing. An empty message is a view that shows nothing.
    """

    def __init__(self, topic: str, threshold: float = 0.0) -> None:
        self.topic, self.threshold = topic, threshold
        self.name = f"topic:{topic}"
        self._held: OrderedDict[int, Any] = OrderedDict()  # messages by stamp [ns]
        self._found: OrderedDict[str, Detections] = OrderedDict()  # by the frame's id
        self._cameras: dict[str, TopicDetector] = {}
        self._lock = threading.Lock()
        self._warned = False

    def of(self, camera: str) -> TopicDetector:
        """The detector of one camera of several, which has a topic of its own."""
        topic = self.topic.replace(CAMERA, camera.strip("/"))
        return self._cameras.setdefault(camera, TopicDetector(topic, self.threshold))

    def add(self, stamp: int, message: Any) -> None:
        """Keep a message with its stamp [ns]."""
        with self._lock:
            self._held[stamp] = message
            while len(self._held) > KEPT:
                self._held.popitem(last=False)

    def nearest(self, stamp: int) -> int | None:
        """Stamp [ns] of the message nearest to the stamp of an image; None without messages."""
        with self._lock:
            return min(self._held, key=lambda one: abs(one - stamp), default=None)

    def has(self, stamp: int) -> bool:
        """Whether there are detections of the image with that stamp [ns]."""
        nearest = self.nearest(stamp)
        return nearest is not None and abs(nearest - stamp) <= SAME

    def take(
        self,
        frame: Frame,
        stamp: int,
        rectifier: Rectifier,
        turns: int,
        T_cam_of: Callable[[str], Pose | None],
    ) -> None:
        """Keep the detections of a frame of the stamp [ns], in the frame's own pixels.

        `T_cam_of` gives the transform (4, 4) of a frame of tf to the camera. Raises RecordingError
        where boxes have no place in the image.
        """
        nearest = self.nearest(stamp)
        with self._lock:
            message = None if nearest is None else self._held.get(nearest)
        if message is None:
            raise RecordingError(f"no detections of {self.topic} at {frame.id}")
        found, size = list[dict[str, Any]](), rectifier.camera.size
        for one in message.detections:
            score, label = _best(one)
            if not self.threshold <= score <= 1.0:
                continue
            outline = np.array([(at.x, at.y) for at in getattr(one, "mask", _NO_MASK).data])
            if hasattr(one.bbox.center, "orientation"):
                name = one.header.frame_id or message.header.frame_id
                T = T_cam_of(name)
                if T is None:
                    raise RecordingError(f"{self.topic}: tf does not link {name!r} to the camera")
                points = _outline(one.bbox, T, rectifier.camera.K)
            else:
                points = rectifier.undistorted(_corners(one.bbox))
                outline = rectifier.undistorted(outline) if len(outline) else outline
            if not (np.isfinite(points).all() and np.isfinite(outline).all()):
                continue
            box = _in_image(points, size, turns)
            if box is not None:
                drawn = None
                if len(outline):
                    outline, limit = _turned(outline, size, turns)
                    drawn = [np.clip(outline, 0, limit)]
                made = {"bbox": box, "score": score, "label": label, "segmentation": drawn}
                found.append(made)
        self._keep(frame.id, found)

    def _keep(self, name: str, found: list[dict[str, Any]]) -> None:
        if len(found) > MAX_DETECTIONS and not self._warned:
            self._warned = True
            line = "%s: %d detections of one image; the best %d count"
            _log.warning(line, self.topic, len(found), MAX_DETECTIONS)
        best = sorted(found, key=lambda one: -one["score"])[:MAX_DETECTIONS]
        entries = [one | {"category_id": number} for number, one in enumerate(best)]
        made = Detections.from_coco(entries, [one["label"] for one in best])
        with self._lock:
            self._found[name] = made
            while len(self._found) > KEPT:
                self._found.popitem(last=False)

    def detect(self, frame: Frame) -> Detections:
        """The detections of a frame; raises RecordingError for one that came without any."""
        if (one := self._cameras.get(frame.camera)) is not None:
            return one.detect(frame)
        with self._lock:
            found = self._found.get(frame.id)
        if found is None:
            raise RecordingError(f"no detections of {self.topic} at {frame.id}")
        return found


def _best(detection: Any) -> tuple[float, str]:
    """Score and category of a detection's best hypothesis; the score is nan where it has none.

    A category is text in ROS 2, a number in ROS 1.
    """
    if hasattr(detection, "class_name"):
        return float(detection.score), str(detection.class_name)[:200]
    found = [getattr(result, "hypothesis", result) for result in detection.results]
    best = max(found, key=lambda one: float(one.score), default=None)
    if best is None:
        return math.nan, ""
    return float(best.score), str(getattr(best, "class_id", getattr(best, "id", "")))[:200]


def _corners(box: Any) -> NDArray[np.float64]:
    """Corners (4, 2) [px] of a BoundingBox2D, none without a size; ROS 1 has its centre flat."""
    centre, size = getattr(box.center, "position", box.center), getattr(box, "size", None)
    width, height = (box.size_x, box.size_y) if size is None else (size.x, size.y)
    if not min(width, height) > 0:
        return np.zeros((0, 2))
    x, y, w, h = float(centre.x), float(centre.y), float(width) / 2, float(height) / 2
    return np.array([(x - w, y - h), (x + w, y - h), (x - w, y + h), (x + w, y + h)])


def _outline(box: Any, T: Pose, K: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (n, 2) [px] of a BoundingBox3D in the image of K (3, 3); none behind the camera.

    `T` (4, 4) takes the box's frame to the camera.
    """
    p, q = box.center.position, box.center.orientation
    turned = (q.x, q.y, q.z, q.w) if any((q.x, q.y, q.z, q.w)) else (0.0, 0.0, 0.0, 1.0)
    T_box = T @ pose_from_quaternion(np.array([p.x, p.y, p.z]), np.array(turned), "a box")
    size = np.array([box.size.x, box.size.y, box.size.z], np.float64)
    points = (_CORNERS * size) @ T_box[:3, :3].T + T_box[:3, 3]
    if not (points[:, 2] > NEAR).all():
        return np.zeros((0, 2))
    seen = points @ K.T
    outline: NDArray[np.float64] = seen[:, :2] / seen[:, 2:]
    return outline


def _turned(
    points: NDArray[np.float64], size: tuple[int, int], turns: int
) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Points (n, 2) [px] of an image of (W, H) in the one that is turned, and that one's size."""
    (width, height), (x, y) = size, points.T
    for _ in range(turns):
        x, y = y, width - 1 - x
        width, height = height, width
    return np.column_stack([x, y]), (width, height)


def _in_image(
    points: NDArray[np.float64], size: tuple[int, int], turns: int
) -> NDArray[np.float64] | None:
    """x, y, width, height [px] of points within an image of (W, H) that is turned; None outside."""
    if not len(points):
        return None
    points, size = _turned(points, size, turns)
    low, high = (np.clip(end(axis=0), 0, size) for end in (points.min, points.max))
    return np.concatenate([low, high - low]) if (high - low >= 1).all() else None
