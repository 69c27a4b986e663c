"""Simulated senses: a detector and a scene classifier with the faults of real ones.

The networks that ship with hereabouts are trained on photographs and detect little in rendered
images, so these senses replace them in the simulated house. They know the truth of each pixel and
add errors: missed objects, low scores, shifted boxes, wrong labels, false detections. The rest of
the system is the real one. Each random draw depends on the seed and the frame alone.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.frames import Detections, Frame, SceneScores
from planner.simulation.camera import NOTHING, SimulatedCamera, TrueView
from planner.simulation.house import HouseRoom

_FILE: Final = Path(__file__).with_name("confusions.csv")


def confusions(kind: str) -> Mapping[str, tuple[str, ...]]:
    """Wrong classes by true class, of one kind of thing."""
    with _FILE.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["kind"] == kind]
    return {row["label"]: tuple(row["taken_for"].split("; ")) for row in rows}


#: Confusions of a detector of COCO classes: true class -> wrong classes.
MISTAKEN_FOR: Final = confusions("object")

#: Confusions of a scene network (Places categories that look alike).
LOOKS_LIKE: Final = confusions("place")


@dataclass(frozen=True, slots=True)
class DetectorFaults:
    """Error rates of the simulated detector.

    Pixels are those of an image 320 wide, since networks scale larger images down. Scores are
    0.25 + 0.7 b, with b from a Beta distribution; for true detections, b is multiplied by their
    chance relative to `recall`.
    """

    recall: float = 0.90  # of a large thing in full view
    half_size: float = 7.0  # [px] square root of the visible area at which recall has halved
    half_visible: float = 0.45  # share of a thing in view at which recall has halved
    jitter: float = 0.03  # standard deviation of each side of a box, as a share of its size
    confusion: float = 0.01  # share of detections under a wrong name
    false_alarms: float = 0.01  # per frame, each somewhere else
    true_score: tuple[float, float] = (6.0, 1.5)  # parameters of the Beta distribution
    false_score: tuple[float, float] = (1.5, 6.0)
    threshold: float = 0.30  # least score that is reported


# box, score, label, and the pixels of the image that show it
Found = tuple[NDArray[np.float64], float, str, NDArray[np.bool_] | None]


class SimulatedDetector:
    """A `Detector` that knows the truth of each pixel and adds errors."""

    name = "simulated-detector"

    def __init__(self, camera: SimulatedCamera, faults: DetectorFaults | None = None) -> None:
        self._camera = camera
        self._faults = faults or DetectorFaults()
        self._pixel = camera.model.width / 320  # [px] a pixel of DetectorFaults

    def detect(self, frame: Frame) -> Detections:
        """Detections in `frame`, best score first."""
        view = self._camera.view(frame.T_map_cam, frame.stamp)
        rng = self._camera.random(frame.id, "detector")
        found = self._shown(view, rng)
        alarms = rng.poisson(self._faults.false_alarms)
        found += [self._false_alarm(view, rng) for _ in range(alarms)]
        found.sort(key=lambda d: -d[1])
        return Detections(
            xyxy=np.array([d[0] for d in found], np.float32).reshape(-1, 4),
            score=np.array([d[1] for d in found], np.float32),
            label=tuple(d[2] for d in found),
            mask=self._masks(found),
        )

    def chance(self, visible: float, silhouette: float) -> float:
        """Recall for a thing with `visible` pixels of its `silhouette` in view."""
        f = self._faults
        size = np.log2(max(np.sqrt(visible) / self._pixel, 1e-3) / f.half_size)
        share = visible / max(silhouette, visible, 1.0)
        return f.recall * sigmoid(size / 0.35) * sigmoid((share - f.half_visible) / 0.08)

    def _masks(self, found: Sequence[Found]) -> tuple[NDArray[np.bool_] | None, ...]:
        """A mask (H, W) of each detection; this detector gives none."""
        return ()

    def _shown(self, view: TrueView, rng: np.random.Generator) -> list[Found]:
        """Detections of what is in view, true ones and under a wrong name."""
        instances = (int(i) for i in np.unique(view.instance) if i != NOTHING)
        return [d for i in instances if (d := self._true_detection(i, view, rng))]

    def _true_detection(
        self, instance: int, view: TrueView, rng: np.random.Generator
    ) -> Found | None:
        pixels = view.instance == instance
        box, visible = box_around(pixels)
        chance, confusion = self._rates(instance, visible, view)
        draw, wrong = rng.random(), rng.random()
        ease = min(chance / max(self._faults.recall, 1e-9), 1.0)
        score = self._score(self._faults.true_score, rng, ease)
        box = box + self._shift(box, rng)
        label = self._camera.house.objects[instance].label
        others = MISTAKEN_FOR.get(label, ())
        if others and wrong < confusion:
            label, score = self._mistaken(instance, others, rng), 0.7 * score
        if draw >= chance or score < self._faults.threshold:
            return None
        return self._inside(box, view), score, label, pixels

    def _rates(self, instance: int, visible: int, view: TrueView) -> tuple[float, float]:
        """Recall and confusion for one thing of the house, of which `visible` pixels are seen."""
        return self.chance(visible, view.silhouette[instance]), self._faults.confusion

    def _mistaken(self, instance: int, others: Sequence[str], rng: np.random.Generator) -> str:
        """The wrong name, one of `others`, of one thing of the house."""
        return others[int(rng.integers(len(others)))]

    @staticmethod
    def _score(beta: tuple[float, float], rng: np.random.Generator, ease: float = 1.0) -> float:
        return float(0.25 + 0.70 * ease * rng.beta(*beta))

    def _shift(self, box: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        size = np.array([box[2] - box[0], box[3] - box[1]] * 2)
        return (self._faults.jitter * size + 0.4 * self._pixel) * rng.standard_normal(4)

    def _false_alarm(self, view: TrueView, rng: np.random.Generator) -> Found:
        height, width = view.depth.shape
        labels = sorted(MISTAKEN_FOR)
        centre = rng.random(2) * (width, height)
        half = rng.uniform(8, 40, 2) * self._pixel
        box = np.concatenate([centre - half, centre + half])
        score = max(self._score(self._faults.false_score, rng), self._faults.threshold)
        return self._inside(box, view), score, labels[rng.integers(len(labels))], None

    @staticmethod
    def _inside(box: NDArray[np.float64], view: TrueView) -> NDArray[np.float64]:
        """`box` within the image, at least two pixels on each side."""
        height, width = view.depth.shape
        lo = np.clip(np.minimum(box[:2], box[2:]), 0, (width - 2, height - 2))
        hi = np.minimum(np.maximum(np.maximum(box[:2], box[2:]), lo + 2), (width, height))
        return np.concatenate([lo, hi])


SURE: Final = 0.62  # mean probability of the category that the scene classifier chooses
SIMILAR: Final = 0.15  # share of frames in which it chooses a similar category


class SimulatedSceneClassifier:
    """A `SceneClassifier` with `labels` for the room that most of the picture shows.

    Raises ValueError where `labels` lacks the category of a room.
    """

    name = "simulated-scenes"

    def __init__(self, camera: SimulatedCamera, labels: Sequence[str]) -> None:
        missing = {room.category for room in camera.house.rooms} - set(labels)
        if missing:
            raise ValueError(f"labels must name every room of the house, lacks {sorted(missing)}")
        self._camera = camera
        self._labels = tuple(labels)

    def classify(self, frame: Frame) -> SceneScores:
        """Probability of each label for `frame`; they sum to one."""
        rng = self._camera.random(frame.id, "scene")
        probability = rng.dirichlet(np.full(len(self._labels), 0.05))
        room = self.room_seen(frame)
        if room is None:
            return SceneScores(dict(zip(self._labels, map(float, probability), strict=True)))
        alike = [label for label in LOOKS_LIKE[room.category] if label in self._labels]
        chosen = room.category
        if alike and rng.random() < SIMILAR:
            chosen = alike[rng.integers(len(alike))]
        sure = rng.beta(8 * SURE, 8 * (1 - SURE))
        rest = rng.dirichlet(np.full(len(alike) + 1, 0.8))
        probability *= 0.35 * (1 - sure)
        for label, share in zip([*alike, room.category], rest, strict=True):
            probability[self._labels.index(label)] += 0.65 * (1 - sure) * share
        probability[self._labels.index(chosen)] += sure
        return SceneScores(dict(zip(self._labels, map(float, probability), strict=True)))

    def room_seen(self, frame: Frame) -> HouseRoom | None:
        """The room that most pixels of `frame` lie in."""
        view = self._camera.view(frame.T_map_cam, frame.stamp)
        rows, cols = np.mgrid[4 : view.depth.shape[0] : 8, 4 : view.depth.shape[1] : 8]
        depth = view.depth[rows, cols]
        u, v = (cols - frame.K[0, 2]) / frame.K[0, 0], (rows - frame.K[1, 2]) / frame.K[1, 1]
        p_cam = np.stack([u * depth, v * depth, depth]).reshape(3, -1)
        p_map = frame.T_map_cam[:3, :3] @ p_cam + frame.T_map_cam[:3, 3:]
        counts = [_count(room, p_map) for room in self._camera.house.rooms]
        best = int(np.argmax(counts))
        return self._camera.house.rooms[best] if counts[best] else None


def box_around(mask: NDArray[np.bool_]) -> tuple[NDArray[np.float64], int]:
    """Box (4,) [px] around the marked pixels of an image, and how many they are."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = np.array([cols[0], rows[0], cols[-1] + 1, rows[-1] + 1], np.float64)
    return box, int(np.count_nonzero(mask))


def _count(room: HouseRoom, p_map: NDArray[np.float64]) -> int:
    x, y = p_map[0], p_map[1]
    inside = (x >= room.xmin) & (x < room.xmax) & (y >= room.ymin) & (y < room.ymax)
    return int(np.count_nonzero(inside))


def sigmoid(x: float) -> float:
    """Logistic function, 0..1."""
    return float(1 / (1 + np.exp(-x)))
