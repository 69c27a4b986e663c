"""Senses of trials: a detector whose faults are as uneven as those of real ones.

Some things are missed or mistaken more often than others, furnishings are taken for objects from
one side, and what the border of the image cuts is detected less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.inference.heads.candidates import MaskGrid
from planner.simulation.camera import NOTHING, SimulatedCamera, TrueView
from planner.simulation.sensors import (
    DetectorFaults,
    Found,
    SimulatedDetector,
    box_around,
    confusions,
    sigmoid,
)

#: Confusions of furnishings that have no class in COCO.
CLUTTER_TAKEN_FOR: Final = confusions("furnishing")


@dataclass(frozen=True, slots=True)
class UnevenFaults(DetectorFaults):
    """Error rates that differ from thing to thing."""

    half_inside: float = 0.25  # share of a thing within the image at which recall has halved
    clutter: float = 0.06  # share of furnishings that are detected as an object, from one side
    clutter_recall: float = 0.4  # chance of such a detection in a view from that side


#: Presets of `hereabouts simulate --senses`.
SENSES: Final[Mapping[str, DetectorFaults]] = {
    "demo": DetectorFaults(),
    "hard": UnevenFaults(
        recall=0.7,
        half_size=8.0,
        jitter=0.05,
        confusion=0.08,
        false_alarms=0.3,
        true_score=(4.0, 2.0),
        false_score=(2.0, 4.5),
        threshold=0.25,
    ),
}
CLUTTER_SIDE: Final = np.deg2rad(50.0)  # [rad] half the directions from which clutter is detected
MASK_CELLS: Final = 28  # along a side of a mask, as in Mask R-CNN
FAVOURED: Final = 0.6  # probability that a wrong label is the thing's favoured one


def detector_of(
    camera: SimulatedCamera, faults: DetectorFaults, *, masks: bool = False
) -> SimulatedDetector:
    """The simulated detector with these faults."""
    if isinstance(faults, UnevenFaults):
        return UnevenDetector(camera, faults, masks=masks)
    return MaskingDetector(camera, faults, masks=masks)


class MaskingDetector(SimulatedDetector):
    """A detector that gives `masks` if it is to."""

    def __init__(self, camera: SimulatedCamera, faults: DetectorFaults, *, masks: bool) -> None:
        super().__init__(camera, faults)
        self._has_masks = masks

    def _masks(self, found: Sequence[Found]) -> tuple[NDArray[np.bool_] | None, ...]:
        return tuple(_coarse_mask(d[0], d[3]) for d in found) if self._has_masks else ()


class UnevenDetector(MaskingDetector):
    """A detector with `UnevenFaults`."""

    def __init__(self, camera: SimulatedCamera, faults: UnevenFaults, *, masks: bool) -> None:
        super().__init__(camera, faults, masks=masks)
        self._uneven = faults

    def cut(self, inside: float) -> float:
        """Factor of the recall for a thing of which the share `inside` is within the image."""
        return sigmoid((inside - self._uneven.half_inside) / 0.06)

    def _shown(self, view: TrueView, rng: np.random.Generator) -> list[Found]:
        furnishings = (int(i) for i in np.unique(view.furnishing) if i != NOTHING)
        found = super()._shown(view, rng)
        return found + [d for i in furnishings if (d := self._clutter(i, view, rng))]

    def _rates(self, instance: int, visible: int, view: TrueView) -> tuple[float, float]:
        """The odds of recall vary by a factor of e^0.5; most of the confusion is of few things."""
        chance, confusion = super()._rates(instance, visible, view)
        chance *= self.cut(view.inside[instance])
        fixed = self._fixed(instance)
        factor = np.exp(0.5 * fixed.standard_normal())
        odds = factor * chance / max(1 - chance, 1e-9)
        return float(odds / (1 + odds)), float(min(confusion * fixed.gamma(0.5) / 0.5, 0.6))

    def _mistaken(self, instance: int, others: Sequence[str], rng: np.random.Generator) -> str:
        """Mostly the wrong name that is this thing's favourite."""
        which = int(rng.integers(len(others)))
        fixed = self._fixed(instance)
        fixed.standard_normal(), fixed.gamma(0.5)  # as in `_rates`
        favourite = int(fixed.integers(12))
        return others[favourite % len(others) if rng.random() < FAVOURED else which]

    def _fixed(self, instance: int) -> np.random.Generator:
        """Randomness that belongs to one thing of the house."""
        item = self._camera.house.objects[instance]
        return self._camera.random(item.name or str(instance), "unevenness")

    def _clutter(self, furnishing: int, view: TrueView, rng: np.random.Generator) -> Found | None:
        """A furnishing detected as an object, always with the same label and from one side."""
        item = self._camera.house.furnishings[furnishing]
        labels = CLUTTER_TAKEN_FOR.get(item.label, ())
        fixed = self._camera.random(item.name or str(furnishing), "clutter")
        is_clutter, side = fixed.random() < self._uneven.clutter, fixed.uniform(-np.pi, np.pi)
        if not labels or not is_clutter:
            return None
        label = labels[fixed.integers(len(labels))]
        x, y = item.centre()[:2] - view.T_map_cam[:2, 3]
        turned = abs((np.arctan2(y, x) - side + np.pi) % (2 * np.pi) - np.pi)
        pixels = view.furnishing == furnishing
        box, visible = box_around(pixels)
        ease = sigmoid(np.log2(np.sqrt(visible) / self._pixel / self._faults.half_size) / 0.35)
        score = self._score(self._faults.false_score, rng)
        if turned > CLUTTER_SIDE or rng.random() >= self._uneven.clutter_recall * ease:
            return None
        if score < self._faults.threshold:
            return None
        return self._inside(box + self._shift(box, rng), view), score, label, pixels


def _coarse_mask(
    box: NDArray[np.float64], pixels: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    """The true pixels (H, W) of a thing within a box, as coarse as masks of networks."""
    if pixels is None:
        return None
    box = box.astype(np.float32)
    x1, y1, x2, y2 = (float(side) for side in box)
    cells = (np.arange(MASK_CELLS) + 0.5) / MASK_CELLS
    rows = np.minimum(y1 + cells * (y2 - y1), pixels.shape[0] - 1).astype(np.intp)
    columns = np.minimum(x1 + cells * (x2 - x1), pixels.shape[1] - 1).astype(np.intp)
    grid = pixels[np.ix_(rows, columns)].astype(np.float32) - np.float32(0.5)
    mask = MaskGrid(grid, (x1, y1, x2, y2)).within(box, pixels.shape)
    return mask if mask.any() else None
