"""Simulated senses: a detector and a scene classifier with the faults of real ones.

The networks hereabouts ships are trained on photographs and see little in drawn pictures, so in the
simulated house these two stand in for them. They know the truth of each pixel and spoil it: missed
and doubtful objects, shifted boxes, wrong names, things that are not there. Everything behind them
is the real system. Each draw depends on the seed and the frame alone, not on what was asked before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.frame import Detections, Frame, SceneScores
from planner.simulation.camera import NOTHING, SimulatedCamera, View
from planner.simulation.house import Room

#: What a detector of COCO classes takes a thing for when it errs.
MISTAKEN_FOR: Final[Mapping[str, tuple[str, ...]]] = {
    "apple": ("orange", "sports ball"),
    "backpack": ("handbag", "suitcase"),
    "bed": ("couch",),
    "bench": ("dining table", "chair"),
    "book": ("cell phone", "remote"),
    "bottle": ("vase", "cup"),
    "bowl": ("cup", "sink"),
    "cell phone": ("remote", "book"),
    "chair": ("bench", "couch"),
    "couch": ("bed", "chair"),
    "cup": ("bowl", "vase", "bottle"),
    "dining table": ("bench", "bed"),
    "handbag": ("backpack", "suitcase"),
    "keyboard": ("laptop", "remote"),
    "laptop": ("tv", "keyboard"),
    "microwave": ("oven", "tv"),
    "mouse": ("remote", "cell phone"),
    "oven": ("microwave", "refrigerator"),
    "remote": ("cell phone", "mouse"),
    "sink": ("bowl", "toilet"),
    "suitcase": ("backpack", "handbag"),
    "toilet": ("sink", "chair"),
    "tv": ("laptop", "microwave"),
    "vase": ("potted plant", "cup", "bottle"),
    "wine glass": ("cup", "vase"),
}

#: What a scene network takes a room for when it errs (Places categories that look alike).
LOOKS_LIKE: Final[Mapping[str, tuple[str, ...]]] = {
    "bedroom": ("hotel room", "dorm room", "nursery"),
    "corridor": ("lobby", "staircase", "locker room"),
    "dining room": ("dinette home", "living room", "banquet hall"),
    "home office": ("office", "bedroom", "living room"),
    "kitchen": ("kitchenette", "galley", "restaurant kitchen"),
    "living room": ("parlor", "hotel room", "waiting room"),
    "shower": ("jail cell", "locker room", "laundromat"),
}


@dataclass(frozen=True, slots=True)
class DetectorFaults:
    """How far the simulated detector is from perfect."""

    recall: float = 0.90  # of a large thing in full view
    half_size: float = 7.0  # [px] square root of the visible area at which recall has halved
    half_visible: float = 0.45  # share of a thing in view at which recall has halved
    jitter: float = 0.03  # standard deviation of each side of a box, as a share of its size
    confusion: float = 0.01  # share of detections under a wrong name
    false_alarms: float = 0.01  # per frame
    threshold: float = 0.30  # no score below this is reported


class SimulatedDetector:
    """A `Detector` that looks at the truth of each pixel and spoils it."""

    name = "simulated-detector"

    def __init__(self, camera: SimulatedCamera, faults: DetectorFaults | None = None) -> None:
        self._camera = camera
        self._faults = faults or DetectorFaults()

    def detect(self, frame: Frame) -> Detections:
        """What is seen in `frame`, best score first."""
        view = self._camera.view(frame.T_map_cam)
        rng = self._camera.random(frame.id, "detector")
        found = [d for i in np.unique(view.instance) if (d := self._look(int(i), view, rng))]
        found += [self._imagine(view, rng) for _ in range(rng.poisson(self._faults.false_alarms))]
        found.sort(key=lambda d: -d[1])
        return Detections(
            xyxy=np.array([d[0] for d in found], np.float32).reshape(-1, 4),
            score=np.array([d[1] for d in found], np.float32),
            label=tuple(d[2] for d in found),
        )

    def chance(self, visible: float, silhouette: float) -> float:
        """Recall for a thing of which `visible` pixels of `silhouette` are seen."""
        f = self._faults
        size = np.log2(max(np.sqrt(visible), 1e-3) / f.half_size)
        share = visible / max(silhouette, visible, 1.0)
        return float(f.recall * _sigmoid(size / 0.35) * _sigmoid((share - f.half_visible) / 0.08))

    def _look(
        self, instance: int, view: View, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], float, str] | None:
        if instance == NOTHING:
            return None
        rows, cols = np.nonzero(view.instance == instance)
        chance = self.chance(len(rows), view.silhouette[instance])
        draw, wrong, score = rng.random(), rng.random(), 0.25 + 0.70 * chance * rng.beta(6, 1.5)
        box = np.array([cols.min(), rows.min(), cols.max() + 1, rows.max() + 1], np.float64)
        box += self._shift(box, rng)
        label = self._camera.house.objects[instance].label
        others = MISTAKEN_FOR.get(label, ())
        if others and wrong < self._faults.confusion:
            label, score = others[rng.integers(len(others))], 0.7 * score
        if draw >= chance or score < self._faults.threshold:
            return None
        return self._inside(box, view), score, label

    def _shift(self, box: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        size = np.array([box[2] - box[0], box[3] - box[1]] * 2)
        return (self._faults.jitter * size + 0.4) * rng.standard_normal(4)

    def _imagine(
        self, view: View, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], float, str]:
        height, width = view.depth.shape
        labels = sorted(MISTAKEN_FOR)
        centre = rng.random(2) * (width, height)
        half = rng.uniform(8, 40, 2)
        box = np.concatenate([centre - half, centre + half])
        return self._inside(box, view), rng.uniform(0.3, 0.5), labels[rng.integers(len(labels))]

    @staticmethod
    def _inside(box: NDArray[np.float64], view: View) -> NDArray[np.float64]:
        """`box` within the image, at least two pixels on each side."""
        height, width = view.depth.shape
        lo = np.clip(np.minimum(box[:2], box[2:]), 0, (width - 2, height - 2))
        hi = np.minimum(np.maximum(np.maximum(box[:2], box[2:]), lo + 2), (width, height))
        return np.concatenate([lo, hi])


@dataclass(frozen=True, slots=True)
class SceneFaults:
    """How far the simulated scene classifier is from perfect."""

    sure: float = 0.62  # mean probability given to the category it settles for
    confusion: float = 0.15  # share of frames in which it settles for one that looks alike


class SimulatedSceneClassifier:
    """A `SceneClassifier` for the room most of the picture shows; `labels` are all it knows.

    Raises ValueError where `labels` lacks the category of a room.
    """

    name = "simulated-scenes"

    def __init__(
        self, camera: SimulatedCamera, labels: Sequence[str], faults: SceneFaults | None = None
    ) -> None:
        missing = {room.category for room in camera.house.rooms} - set(labels)
        if missing:
            raise ValueError(f"labels must name every room of the house, lacks {sorted(missing)}")
        self._camera = camera
        self._labels = tuple(labels)
        self._faults = faults or SceneFaults()

    def classify(self, frame: Frame) -> SceneScores:
        """Probability of each label for `frame`; they sum to one."""
        rng = self._camera.random(frame.id, "scene")
        probability = rng.dirichlet(np.full(len(self._labels), 0.05))
        room = self.room_seen(frame)
        if room is None:
            return SceneScores(dict(zip(self._labels, map(float, probability), strict=True)))
        alike = [label for label in LOOKS_LIKE[room.category] if label in self._labels]
        settled = room.category
        if alike and rng.random() < self._faults.confusion:
            settled = alike[rng.integers(len(alike))]
        sure = rng.beta(8 * self._faults.sure, 8 * (1 - self._faults.sure))
        rest = rng.dirichlet(np.full(len(alike) + 1, 0.8))
        probability *= 0.35 * (1 - sure)
        for label, share in zip([*alike, room.category], rest, strict=True):
            probability[self._labels.index(label)] += 0.65 * (1 - sure) * share
        probability[self._labels.index(settled)] += sure
        return SceneScores(dict(zip(self._labels, map(float, probability), strict=True)))

    def room_seen(self, frame: Frame) -> Room | None:
        """The room that most pixels of `frame` lie in."""
        view = self._camera.view(frame.T_map_cam)
        rows, cols = np.mgrid[4 : view.depth.shape[0] : 8, 4 : view.depth.shape[1] : 8]
        depth = view.depth[rows, cols]
        u, v = (cols - frame.K[0, 2]) / frame.K[0, 0], (rows - frame.K[1, 2]) / frame.K[1, 1]
        p_cam = np.stack([u * depth, v * depth, depth]).reshape(3, -1)
        p_map = frame.T_map_cam[:3, :3] @ p_cam + frame.T_map_cam[:3, 3:]
        counts = [_count(room, p_map) for room in self._camera.house.rooms]
        best = int(np.argmax(counts))
        return self._camera.house.rooms[best] if counts[best] else None


def _count(room: Room, p_map: NDArray[np.float64]) -> int:
    x, y = p_map[0], p_map[1]
    inside = (x >= room.xmin) & (x < room.xmax) & (y >= room.ymin) & (y < room.ymax)
    return int(np.count_nonzero(inside))


def _sigmoid(x: float) -> float:
    return float(1 / (1 + np.exp(-x)))
