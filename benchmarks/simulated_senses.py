"""Error rates of the simulated detectors: `python -m benchmarks.simulated_senses [SEED ...]`.

In every fourth frame of the tours of random houses, objects are matched to detections by overlap of
boxes, whatever the label. Prints a Markdown table: recall of things seen well and of all others of
at least 16 pixels (images are 320 wide), wrong labels among matched detections, and detections that
match nothing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.houses.random_house import random_house
from lab.recordings.object_truth import VisibilityRecord
from perception.frames import Detections
from planner.simulation.houses.house import House
from planner.simulation.robot.house_robot import SimulatedTour
from planner.simulation.sensing.camera import CameraModel, SimulatedCamera, TrueView
from planner.simulation.sensing.sensors import SENSES, SimulatedDetector

HEADER = (
    "| senses | frames | detections a frame | recall, seen well | recall, others | wrong label | "
    "false a frame | score of true: 10 / 50 / 90 % | of false |\n" + 9 * "|---" + "|"
)
STRIDE = 4  # every how many frames of a tour are looked at
MATCHED = 0.5  # IoU of boxes


@dataclass(slots=True)
class Tally:
    """Counts over all frames."""

    frames: int = 0
    well: list[bool] = field(default_factory=list)  # found or not, of things seen well
    other: list[bool] = field(default_factory=list)
    wrong: int = 0
    true_scores: list[float] = field(default_factory=list)
    false_scores: list[float] = field(default_factory=list)

    def add(self, house: House, view: TrueView, found: Detections, seen_well: set[str]) -> None:
        """Count one frame."""
        self.frames += 1
        left = set(range(len(found)))
        for instance, box in _boxes(view):
            overlap = _iou(box, found.xyxy)
            best = max(left, key=lambda k: overlap[k], default=None)
            hit = best is not None and overlap[best] >= MATCHED
            item = house.objects[instance]
            (self.well if item.name in seen_well else self.other).append(hit)
            if hit and best is not None:
                left.remove(best)
                self.wrong += found.label[best] != item.label
                self.true_scores.append(float(found.score[best]))
        self.false_scores += [float(found.score[k]) for k in left]

    def row(self, name: str) -> str:
        """A row of the table."""
        matched = len(self.true_scores)
        true, false = (
            " / ".join(f"{q:.2f}" for q in np.quantile(scores or [np.nan], (0.1, 0.5, 0.9)))
            for scores in (self.true_scores, self.false_scores)
        )
        return (
            f"| `{name}` | {self.frames} | "
            f"{(matched + len(self.false_scores)) / self.frames:.1f} | {np.mean(self.well):.2f} | "
            f"{np.mean(self.other):.2f} | {self.wrong / matched:.3f} | "
            f"{len(self.false_scores) / self.frames:.2f} | {true} | {false} |"
        )


def _boxes(view: TrueView) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """(instance, box (4,) [px]) of what shows at least 16 pixels."""
    for instance in np.unique(view.instance).tolist():
        rows, cols = np.nonzero(view.instance == instance)
        if instance >= 0 and len(rows) >= 16:
            yield instance, np.array([cols.min(), rows.min(), cols.max() + 1, rows.max() + 1])


def _iou(box: NDArray[np.float64], boxes: NDArray[np.float32]) -> NDArray[np.float64]:
    """(n,) intersection over union of `box` (4,) with `boxes` (n, 4)."""
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=1)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + np.prod(box[2:] - box[:2])
    return np.asarray(shared / (area - shared), np.float64)


def measured(seeds: Sequence[int]) -> dict[str, Tally]:
    """The counts of every preset over the houses of `seeds`."""
    tallies = {name: Tally() for name in SENSES}
    for seed in seeds:
        model = CameraModel()
        camera = SimulatedCamera(random_house(seed), model, seed)
        tour = SimulatedTour(camera)
        detectors = {name: SimulatedDetector(camera, faults) for name, faults in SENSES.items()}
        for frame in (next(tour.frames(k)) for k in range(0, len(tour), STRIDE)):
            view = camera.view(frame.T_map_cam, frame.stamp)
            record = VisibilityRecord(camera.house, model)
            record.add(frame.id, view)
            seen_well = {name for name, frames in record.frames.items() if frames}
            for name, detector in detectors.items():
                tallies[name].add(camera.house, view, detector.detect(frame), seen_well)
    return tallies


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="*", default=[100, 101, 102, 103, 104])
    print(HEADER)  # noqa: T201
    for name, tally in measured(parser.parse_args().seeds).items():
        print(tally.row(name))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())
