"""Readings of a network: what its outputs may mean, decided by the values of a first answer.

Shapes of outputs are shared by many ways of exporting. On a real picture the range of coordinates,
whole numbers among classes and the sums of scores leave one reading; where they leave two that say
different things, nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.inference.heads.candidates import Head
from perception.inference.session import Fitted

Answer = tuple[list[NDArray[np.generic]], Fitted]


@dataclass(frozen=True, slots=True)
class Reading:
    """One meaning of a network, with its labels and the format of its input."""

    head: Head
    labels: tuple[str, ...]
    resize: str
    values: str


class Readings:
    """The readings of one network; the first answers decide."""

    def __init__(self, found: Sequence[Reading]) -> None:
        self._left = tuple(found)
        self.decided = len(self._left) == 1

    @property
    def likeliest(self) -> Reading:
        """The one that was decided for, or the likeliest."""
        return self._left[0]

    def decide(self, answer_of: Callable[[Reading], Answer], threshold: float) -> bool:
        """Whether one reading is left, by an answer where several are; they may find nothing.

        Raises ModelError where none fits, or two that find different things.
        """
        if self.decided:
            return True
        outputs, fitted = answer_of(self.likeliest)
        fitting = [one for one in self._left if _fits(one, outputs, fitted, threshold)]
        if not fitting:
            raise ModelError(
                f"what it answers fits none of its readings ({_names(self._left)}); export it in "
                "another way, with names of its outputs"
            )
        found = [_seen(one, outputs, fitted, threshold) for one in fitting]
        if len(fitting) > 1:
            if not any(found):
                return False
            if any(one != found[0] for one in found[1:]):
                raise ModelError(
                    "what it answers has two meanings and more: "
                    + "; ".join(
                        f"{one.head.name}: {_told(seen)}"
                        for one, seen in zip(fitting, found, strict=True)
                    )
                    + f"; --head {' or --head '.join(one.head.name for one in fitting)} chooses"
                )
        self._left, self.decided = (fitting[0],), True
        return True


Seen = list[tuple[str, tuple[int, ...]]]


def _fits(
    reading: Reading, outputs: list[NDArray[np.generic]], fitted: Fitted, least: float
) -> bool:
    try:
        head = reading.head
        if not head.fits(outputs, fitted, least):
            return False
        return bool(np.all(head.candidates(outputs, fitted, least).label < len(reading.labels)))
    except (ModelError, IndexError, ValueError):  # shapes that it does not have
        return False


def _seen(
    reading: Reading, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
) -> Seen:
    """What a reading finds in an answer, best first: labels and boxes to the pixel."""
    found = reading.head.candidates(outputs, fitted, threshold)
    names = dict(enumerate(reading.labels))
    best = np.argsort(-found.score, kind="stable")[:100]
    return [
        (names.get(int(found.label[i]), "?"), tuple(np.rint(found.xyxy[i]).astype(int).tolist()))
        for i in best
        if np.isfinite(found.xyxy[i]).all()
    ]


def _told(seen: Seen) -> str:
    return f"{seen[0][0]} at {' '.join(map(str, seen[0][1]))}" if seen else "nothing"


def _names(readings: Sequence[Reading]) -> str:
    return ", ".join(one.head.name for one in readings)
