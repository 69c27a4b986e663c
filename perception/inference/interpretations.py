"""Interpretations of a network's outputs, of which the values of a first answer choose one.

Shapes of outputs are shared by many ways of exporting. On a real picture the range of coordinates,
whole numbers among classes and the sums of scores leave one interpretation; where they leave two
that say different things, nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.inference.heads.candidates import Head
from perception.inference.session import Fitted

RANGES: Final = ("0..1", "0..255", "imagenet")  # of colours
SURE: Final = 0.8  # score that hardly any picture in a wrong range of colours reaches
TRIES: Final = 20  # pictures that show nothing by which other ranges are tried

Answer = tuple[list[NDArray[np.generic]], Fitted]


@dataclass(frozen=True, slots=True)
class Interpretation:
    """Interpretation of the outputs of a network, with its labels and the format of its input."""

    head: Head
    labels: tuple[str, ...]
    resize: str
    values: str


class Interpretations:
    """Interpretations of one network; its first answers decide.

    `problem` tells what others lack, `guessed` whether nothing says how it takes colours, `chosen`
    that somebody says what its outputs mean.
    """

    def __init__(
        self,
        found: Sequence[Interpretation],
        problem: str = "",
        *,
        guessed: bool = False,
        chosen: bool = False,
    ) -> None:
        self._left, self._problem = tuple(found), problem
        self.decided = chosen
        self._tries = TRIES if guessed else 0  # pictures by which the range of colours is chosen

    @property
    def likeliest(self) -> Interpretation:
        """The one that was decided for, or the likeliest."""
        return self._left[0]

    def choose_range(self, answer_of: Callable[[Interpretation], Answer], threshold: float) -> str:
        """The other range of colours by which a picture shows something where its own shows none.

        It is taken from then on; "" where there is none, or the own has shown something before.
        """
        if self._tries == 0:
            return ""
        own, _, order = self.likeliest.values.partition(" ")
        if (found := self._best(own, answer_of, threshold)) >= SURE:
            self._tries = 0
        if found > 0:
            return ""
        self._tries -= 1
        others = [one for one in RANGES if one != own]
        best, other = max((self._best(one, answer_of, threshold), one) for one in others)
        if best < SURE:
            return ""
        self._left, self._tries = self._in_range(other), 0
        return f"{other} {order}".strip()

    def _in_range(self, values: str) -> tuple[Interpretation, ...]:
        orders = (one.values.partition(" ")[1:] for one in self._left)
        return tuple(
            replace(one, values="".join((values, *order)))
            for one, order in zip(self._left, orders, strict=True)
        )

    def _best(
        self, values: str, answer_of: Callable[[Interpretation], Answer], least: float
    ) -> float:
        """The highest score of a picture with colours in a range; 0: none above `least`."""
        readings = self._in_range(values)
        answer = answer_of(readings[0])
        found = [
            one.head.candidates(*answer, least).score
            for one in readings
            if _fits(one, *answer, least)
        ]
        return max((float(score.max(initial=0.0)) for score in found), default=0.0)

    def decide(self, answer_of: Callable[[Interpretation], Answer], threshold: float) -> bool:
        """Whether one reading is left, by an answer where several are; they may find nothing.

        Raises ModelError where none fits, or two that find different things.
        """
        if self.decided:
            return True
        outputs, fitted = answer_of(self.likeliest)
        # of one reading, classes beyond its labels have a line of their own
        answer, alone = (outputs, fitted, threshold), len(self._left) == 1
        fits = [one.head.fits(*answer) if alone else _fits(one, *answer) for one in self._left]
        fitting = [one for one, good in zip(self._left, fits, strict=True) if good]
        if not fitting:
            # its own error tells more, where there is one
            self.likeliest.head.candidates(outputs, fitted, threshold)
            raise ModelError(
                f"what it answers fits none of its readings ({_names(self._left)}); export it in "
                "another way, with names of its outputs, or give the labels it was trained with"
                f"{self._problem}"
            )
        found = [_seen(one, outputs, fitted, threshold) for one in fitting]
        if not any(found) and (alone or len(fitting) > 1):
            return alone
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
    reading: Interpretation, outputs: list[NDArray[np.generic]], fitted: Fitted, least: float
) -> bool:
    try:
        head = reading.head
        if not head.fits(outputs, fitted, least):
            return False
        found = head.candidates(outputs, fitted, least if head.overlapping else 0.0)
        return bool(np.all(found.label < len(reading.labels)))
    except (ModelError, IndexError, ValueError):  # shapes that it does not have
        return False


def _seen(
    reading: Interpretation, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
) -> Seen:
    """A reading finds these in an answer, best first: labels and boxes to the pixel."""
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


def _names(readings: Sequence[Interpretation]) -> str:
    return ", ".join(one.head.name for one in readings)
