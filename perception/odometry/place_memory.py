"""Place memory: which key frames may show what an image shows, by votes of its features.

Each of the strongest features votes for the key frame with the most similar descriptor, where that
is much more similar than those of other key frames' neighbourhoods are on average.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.odometry.features import MAX_HAMMING, Features

KEPT: Final = 120  # strongest features of a key frame that are kept
ASKED: Final = 200  # strongest features of an image that vote
NEAREST: Final = 3  # descriptors that a feature votes for
MIN_VOTES: Final = 8


@dataclass(slots=True)
class PlaceMemory:
    """The strongest descriptors of all key frames."""

    _descriptors: list[NDArray[np.uint8]] = field(default_factory=list)
    _keys: list[NDArray[np.intp]] = field(default_factory=list)

    def add(self, key: int, features: Features) -> None:
        """Keep a key frame's strongest features."""
        kept = features.descriptors[:KEPT]
        self._descriptors.append(kept)
        self._keys.append(np.full(len(kept), key))

    def forget(self, key: int) -> None:
        """Forget a key frame's features; its number stays its own."""
        self._descriptors[key], self._keys[key] = self._descriptors[key][:0], self._keys[key][:0]

    def similar(self, features: Features, allowed: NDArray[np.bool_], count: int) -> list[int]:
        """The `count` key frames with the most votes among the `allowed` ones (n,)."""
        chosen = [number for number, ok in enumerate(allowed) if ok and len(self._keys[number])]
        if not chosen or not len(features):
            return []
        stored = np.concatenate([self._descriptors[number] for number in chosen])
        keys = np.concatenate([self._keys[number] for number in chosen])
        nearest = min(NEAREST, len(stored))
        matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
        found = matcher.knnMatch(features.descriptors[:ASKED], stored, k=nearest)
        voted = [keys[m.trainIdx] for row in found for m in row if m.distance <= MAX_HAMMING]
        votes = np.bincount(np.array(voted, np.intp), minlength=len(allowed))
        best = np.argsort(-votes, kind="stable")[:count]
        return [int(key) for key in best if votes[key] >= MIN_VOTES]
