"""Looks of things that left and of things that appeared: whether they may be one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.model.errors import ModelError, RecordingError
from kg.model.records import Evidence
from kg.model.regular_files import read_bytes
from mapping.looks.likeness import likeness, most_alike
from mapping.looks.object_looks import network
from mapping.objects.tracks import Track

#: log-likelihood ratio of one thing against two of a category, by how much more alike they look
#: than the new thing and the most similar other one: its value at 0, and its slope. Fitted to the
#: lounge and judged on the kitchen (lab/research/measurements.md).
EVEN: Final = 0.5
SLOPE: Final = 6.9
_MAX_LOG_RATIO: Final = 3.0  # of the log-likelihood ratio, either way
_KEPT: Final = 1000  # things in memory

Floats = NDArray[np.float32]


class MovedLooks:
    """Compares tracks by their pictures: those in the folder of a map, or of recent frames."""

    def __init__(self, folder: Path, recent: Callable[[Evidence], bytes | None]) -> None:
        self._pictures, self._recent = ObjectPictures(folder), recent
        self._known = dict[tuple[str | int, str], Floats | None]()  # by thing and best frame

    def ratio(self, old: Track, new: Track, others: Sequence[Track]) -> float:
        """Likelihood ratio of `new` being `old` and being another thing, by their looks.

        `others` are further things of the category that were known before `new`. 1 where any has
        no picture: without others, nothing tells how alike things of the category are here.
        """
        a, b = self._features(old), self._features(new)
        if a is None or b is None:
            return 1.0
        known = (self._features(other) for other in others)
        rival = most_alike(b, (one for one in known if one is not None))
        if rival is None:
            return 1.0
        log_ratio = EVEN + SLOPE * (likeness(a, b) - rival)
        return math.exp(min(max(log_ratio, -_MAX_LOG_RATIO), _MAX_LOG_RATIO))

    def _features(self, track: Track) -> Floats | None:
        """(n, F) features of a track's views; None without any."""
        # another best observation of it brings another picture
        key = track.iri or track.number, "" if track.best is None else track.best.frame
        if key not in self._known:
            found = [_described(data) for data in self._views(track)]
            shown = [features for features in found if features is not None]
            self._known[key] = np.stack(shown) if shown else None
            if len(self._known) > _KEPT:
                del self._known[next(iter(self._known))]
        return self._known[key]

    def _views(self, track: Track) -> Iterator[bytes]:
        paths = self._pictures.views_of(track.iri) if track.iri is not None else []
        for path in paths:
            with suppress(OSError):  # removed meanwhile
                yield read_bytes(path, MAX_BYTES)
        if not paths and track.best is not None:
            data = self._recent(track.best)
            if data is not None:
                yield data


def _described(picture: bytes) -> Floats | None:
    """(F,) features of a picture; None for one that shows nothing."""
    try:
        return network().describe(picture)[0]
    except (RecordingError, ModelError):
        return None
