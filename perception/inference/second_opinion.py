"""Second opinion: answers of a network that nobody described, against those of the bundled one.

Shapes and values do not tell whether boxes have y first, or whether classes count from 0, from 1 or
by COCO's ids. Where a network finds the things that the bundled one finds only once its answers are
read in such another way, that way is told.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import Detections
from perception.inference.class_labels import NO_OBJECT, coco_by_id

PICTURES: Final = 40  # with things, after which nothing is concluded any more
SURE: Final = 0.5  # score of things that are compared
SAME: Final = 0.5  # IoU of two boxes of one thing
ENOUGH: Final = 4  # things that clear a network, or that fit in another way ...
TIMES: Final = 4  # ... which are so many times as many as those that fit as it is read
KINDS: Final = 2  # categories of such things
OWN: Final = "as it is read"

_log = logging.getLogger(__name__)
_Detect = Callable[[NDArray[np.uint8]], Detections]


class SecondOpinion:
    """Comparison of a network's first answers with another's.

    Args:
        name: name of the network.
        labels: its labels.
        other: makes the other detector, whose labels are COCO's, once it is needed.
    """

    def __init__(self, name: str, labels: Sequence[str], other: Callable[[], _Detect]) -> None:
        self._name, self._other = name, cache(other)
        self._fits = Counter[str]()  # things by the way of reading
        self._kinds = dict[str, set[str]]()  # their categories
        known = [one for one in coco_by_id() if one != NO_OBJECT]
        self._left = PICTURES if {*labels} == {*known} else 0
        by_id = {k: one for k, one in enumerate(coco_by_id()) if one != NO_OBJECT}
        numbers = range(len(known))
        self._names: dict[str, Mapping[str, str]] = {
            "as COCO's ids, 1 to 90": {known[k]: by_id[k] for k in numbers if k in by_id},
            "as classes from 1": {known[k]: known[k - 1] for k in numbers[1:]},
            "as classes from 0": {one: known[k] for k, one in by_id.items() if k < len(known)},
        }

    def compare(self, rgb: NDArray[np.uint8], found: Detections) -> None:
        """Compare what was found in an image (H, W, 3); warn once another way of reading fits."""
        sure = found.chosen(np.flatnonzero(found.score >= SURE))
        if not self._left or not len(sure):
            return
        self._left -= 1
        try:
            seen = self._other()(rgb)
        except ModelError as error:  # an opinion less is no reason to stop
            self._left = 0
            _log.info("%s: its answers are not compared: %s", self._name, error)
            return
        self._count(sure, seen.chosen(np.flatnonzero(seen.score >= SURE)), rgb.shape)
        own, fits = self._fits[OWN], max(self._fits.values(), default=0)
        ways = [way for way, count in self._fits.items() if count == fits and way != OWN]
        if own >= ENOUGH:
            self._left = 0
        elif ways and fits >= max(ENOUGH, TIMES * own) and len(self._kinds[ways[0]]) >= KINDS:
            self._left = 0
            _log.warning(
                "%s: %d of the things that the bundled network sees fit its answers %s, %d as they "
                "are read; another --head, a list of its labels in their order beside it, or an "
                "export with x first would work",
                self._name,
                fits,
                " or ".join(ways),
                own,
            )

    def _count(self, found: Detections, seen: Detections, shape: tuple[int, ...]) -> None:
        swapped = found.xyxy[:, [1, 0, 3, 2]]
        ratio = shape[1] / shape[0]
        stretched = swapped * np.array([ratio, 1 / ratio] * 2, np.float32)
        for box, label in zip(seen.xyxy, seen.label, strict=True):
            fitting = [found.label[k] for k in np.flatnonzero(_overlaps(found.xyxy, box) >= SAME)]
            ways = {OWN} if label in fitting else set[str]()
            ways |= {way for way, names in self._names.items() if label in map(names.get, fitting)}
            for turned in (swapped, stretched):
                near = np.flatnonzero(_overlaps(turned, box) >= SAME)
                ways |= {"with y first"} if label in [found.label[k] for k in near] else set()
            for way in ways if OWN not in ways or len(ways) == 1 else ():
                self._fits[way] += 1
                self._kinds.setdefault(way, set()).add(label)


def _overlaps(boxes: NDArray[np.float32], box: NDArray[np.float32]) -> NDArray[np.float32]:
    """IoU (n,) of boxes (n, 4) with a box (4,)."""
    low, high = np.maximum(boxes[:, :2], box[:2]), np.minimum(boxes[:, 2:], box[2:])
    both = np.maximum(high - low, 0).prod(axis=1)
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + (box[2:] - box[:2]).prod()
    return np.asarray(both / np.maximum(areas - both, 1e-6), np.float32)
