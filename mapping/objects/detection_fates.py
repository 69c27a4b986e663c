"""Detection fates: what became of each detection, counted by category.

Boxes of one category on one thing of a frame count once. Detections of a candidate follow it: they
are an object's once it is one, and another thing's once it is merged into that.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.detection_report import Fate
from mapping.objects.tracks import Track

_ONE_SIDE: Final = math.radians(30)  # from the first direction, up to which all are one side
_SWEEP: Final = 100  # frames between two looks for things that are no longer held
_MOST_NAMES: Final = 1000  # that are counted apart; labels may be any text
_LONGEST: Final = 100  # characters of a label
_REMEMBERED: Final = 100  # forgotten candidates, the most probable ones
OTHERS: Final = "other labels"


@dataclass(eq=False, slots=True)
class ThingFates:
    """Detections of one thing."""

    track: Track
    counts: Counter[str] = field(default_factory=Counter)  # by name of the category
    looks: int = 0  # frames that showed it
    bearing: float | None = None  # [rad] from it to the first camera
    one_side: bool = True

    def see(self, names: Iterable[str], bearing: float | None) -> None:
        """Count detections in one frame, from the direction `bearing` [rad]."""
        self.counts.update(names)
        self.looks += 1
        self._turn(bearing)

    def merge(self, other: ThingFates) -> None:
        """Take over the detections of another track of the same thing."""
        self.counts.update(other.counts)
        self.looks += other.looks
        self.one_side &= other.one_side
        self._turn(other.bearing)

    def _turn(self, bearing: float | None) -> None:
        if self.bearing is None or bearing is None:
            self.bearing = bearing if self.bearing is None else self.bearing
        elif self.one_side:
            turn = abs(bearing - self.bearing) % math.tau
            self.one_side = min(turn, math.tau - turn) <= _ONE_SIDE


class DetectionFates:
    """Counter of detection fates; `name` gives the category of a label or of an IRI in words.

    What a frame adds can be taken back until it is settled.
    """

    def __init__(self, name: Callable[[str], str] = str) -> None:
        self._name = name
        self.frames = 0
        self.counts: dict[str, Counter[Fate]] = {}  # by name; of what is none's of a held thing
        self.objects: dict[str, Counter[str]] = {}  # by name: detections of objects, by IRI
        self.merged: Counter[str] = Counter()  # by name: things merged into another one
        self.forgotten: list[ThingFates] = []  # candidates that are no longer held
        self.things: dict[int, ThingFates] = {}  # those that are held, by number of the track
        self._unused: list[tuple[Fate, str]] = []  # of this frame: label or IRI
        self._unnamed: Counter[tuple[Fate, str]] = Counter()  # of the frames before
        self._seen: list[tuple[Track, frozenset[str], float | None]] = []
        self._merges: list[tuple[Track, Track]] = []
        self._open = False  # whether a frame has begun and is not settled

    def begin(self, held: Sequence[Track]) -> None:
        """Begin a frame; `held` are the tracks that the mapper has."""
        self.settle()
        self.frames += 1
        self._open = True
        if self.frames % _SWEEP == 0:
            self.sweep(held)

    def unused(self, fate: Fate, names: Iterable[str]) -> None:
        """Count detections, by labels or IRIs, that belong to no thing."""
        self._unused += [(fate, name) for name in names]

    def unplaced(self, depth: float | None, nearest: float, names: Iterable[str]) -> None:
        """Count detections at a `depth` [m] that is out of reach; None: without depth."""
        near = depth is not None and depth < nearest
        self.unused(Fate.NO_DEPTH if depth is None else Fate.NEAR if near else Fate.FAR, names)

    def seen(
        self,
        track: Track,
        categories: frozenset[str],
        camera: NDArray[np.float64] | None = None,
    ) -> None:
        """Count detections of a track, of categories by IRI, by a camera at (2..3,) [m]."""
        bearing = None
        if camera is not None:
            bearing = math.atan2(camera[1] - track.p_map[1], camera[0] - track.p_map[0])
        self._seen.append((track, categories, bearing))

    def merge(self, kept: Track, absorbed: Track) -> None:
        """Count the detections of `absorbed` as those of `kept`."""
        self._merges.append((kept, absorbed))

    def undo(self) -> None:
        """Take back a frame that is not settled; merged tracks stay merged."""
        self.frames -= self._open
        self._open = False
        self._unused.clear()
        self._seen.clear()

    def settle(self) -> None:
        """Add this frame's detections to the counts; they can no longer be taken back."""
        self._unnamed.update(self._unused)
        for track, categories, bearing in self._seen:
            names = [self._name(category) for category in categories]
            self._thing(track).see(names, bearing)
        for kept, absorbed in self._merges:
            if (thing := self.things.pop(absorbed.number, None)) is not None:
                self._thing(kept).merge(thing)
                self.merged.update(thing.counts.keys())
        self._unused, self._seen, self._merges, self._open = [], [], [], False

    def sweep(self, held: Sequence[Track]) -> None:
        """Settle what became of things that the mapper no longer has, and name the rest."""
        for (fate, key), count in self._unnamed.items():
            self.add(self._name(key)[:_LONGEST], fate, count)
        self._unnamed.clear()
        kept = {track.number for track in held}
        for number in [number for number in self.things if number not in kept]:
            thing = self.things.pop(number)
            for name, count in thing.counts.items():
                if thing.track.iri is None:
                    self.add(name, Fate.FORGOTTEN, count)
                else:
                    self.objects.setdefault(name, Counter())[thing.track.iri] += count
            if thing.track.iri is None:
                self.forgotten.append(thing)
        self.forgotten = heapq.nlargest(_REMEMBERED, self.forgotten, lambda one: one.track.peak)
        present = {track.iri for track in held}
        for name, counts in self.objects.items():
            for iri in [iri for iri in counts if iri not in present]:
                self.add(name, Fate.LEFT, counts.pop(iri))

    def add(self, name: str, fate: Fate, count: int = 1) -> None:
        """Add to the count of a category or label."""
        if name not in self.counts and len(self.counts) >= _MOST_NAMES:
            name = OTHERS
        self.counts.setdefault(name, Counter())[fate] += count

    def _thing(self, track: Track) -> ThingFates:
        return self.things.setdefault(track.number, ThingFates(track))
