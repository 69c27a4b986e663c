"""Moved things: objects that left their spots, and the moves by which they were found again.

The probability that the new thing n is the old thing o weighs each pair by its labels, sizes,
places and times against two alternatives: n has another origin (it is new, or was missed so far),
and o went elsewhere. Pairs are assigned at greatest total probability. A pair holds where n is
probably any of the things that left, and o any of the things that appeared: after an exchange of
two equal cups, each of the new ones may be either of the old ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kg.model.records import DepartedRecord
from mapping.objects.association import assign
from mapping.objects.existence import category_probabilities
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

#: prior probability that a thing left within [s] after it was last seen
Departed = Callable[[Track, float], float]
#: likelihood ratio, by their looks, of the second thing being the first and being another one;
#: the rest are further things of the category that were known before
LookRatio = Callable[[Track, Track, Sequence[Track]], float]
_UNLIKELY = 0.02  # weight below which looks are not compared


@dataclass(frozen=True, slots=True, eq=False)
class Absentee:
    """A thing that is perhaps not where it was last seen."""

    track: Track
    left: float  # probability that it left, by the views of its spot since
    looked: bool  # whether its spot was viewed; only such things are found elsewhere


def moved_things(
    absent: Sequence[Absentee],
    appeared: Sequence[Track],
    departed: Departed,
    now: float,
    count: Callable[[str], int],
    settings: ObjectSettings,
    looks: LookRatio | None = None,
) -> list[tuple[Track, Track]]:
    """Pairs (thing that left, thing that appeared) that are one thing.

    `now` [s] is the present, `count` gives the number of things of a category in the map, `looks`
    compares pictures where there are any.
    """
    if not absent or not appeared:
        return []
    weights: NDArray[np.float64] = np.zeros((len(absent), len(appeared)))
    labels = cache(_labels)
    distance = _distances(absent, appeared)
    for row, column in np.argwhere(_in_reach(absent, appeared, distance, settings)).tolist():
        one, n = absent[row], appeared[column]
        alike = _alike(labels(one.track), labels(n), count, settings)
        far = float(distance[row, column])
        plain = alike * weight(one, n, far, departed, now, settings) if alike else 0.0
        if looks is not None and plain >= _UNLIKELY:
            plain *= looks(one.track, n, _rivals(one.track, n, absent))
        weights[row, column] = plain
    by_thing, by_origin = weights.sum(axis=0), weights.sum(axis=1)
    probability = weights / (1 + by_thing[None, :] + by_origin[:, None] - weights)
    cost = np.where(probability > 0, 1 - probability, np.inf)
    least = settings.moved / (1 - settings.moved)  # odds
    return [
        (absent[row].track, appeared[column])
        for row, column in assign(cost).items()
        if absent[row].looked and min(by_thing[column], by_origin[row]) >= least
    ]


def _distances(absent: Sequence[Absentee], appeared: Sequence[Track]) -> NDArray[np.float64]:
    """Distance [m] of each of the absent (rows) and each that appeared (columns)."""
    there = np.array([one.track.p_map for one in absent])
    here = np.array([n.p_map for n in appeared])
    distance: NDArray[np.float64] = np.linalg.norm(there[:, None] - here, axis=2)
    return distance


def _in_reach(
    absent: Sequence[Absentee],
    appeared: Sequence[Track],
    distance: NDArray[np.float64],
    s: ObjectSettings,
) -> NDArray[np.bool_]:
    """Which of the absent (rows) may be which that appeared (columns), by time and distance."""
    last = np.array([one.track.last_seen for one in absent])
    time = np.array([n.first_seen for n in appeared]) - last[:, None]
    reach: NDArray[np.bool_] = (time > 0) & (distance <= 0.5 + s.speed * time)
    return reach


def weight(
    one: Absentee,
    n: Track,
    distance: float,
    departed: Departed,
    now: float,
    s: ObjectSettings,
) -> float:
    """Likelihood ratio of `n`, in reach, being that thing and of another origin, but for labels."""
    o = one.track
    stretch = math.log(n.size / o.size) ** 2 / 2
    narrow, wide = s.same_size, s.other_size
    size = wide / narrow * math.exp(stretch / wide**2 - stretch / narrow**2)
    if distance < _gate(o, n, s):  # it stood there all the time
        return s.returned * o.peak * max(size, s.any_size)
    place = math.exp(-distance / s.short_way)
    time = departed(o, n.first_seen - o.last_seen)
    if one.looked:  # it left, or was never there
        time = one.left * time / (departed(o, now - o.last_seen) + s.mistaken)
    return time * o.peak * max(size, s.any_size) * place


def _alike(
    labels: Mapping[str, float],
    others: Mapping[str, float],
    count: Callable[[str], int],
    s: ObjectSettings,
) -> float:
    """Likelihood ratio, by the labels of two things, of their being one and being two."""
    alike = 0.0
    for category in sorted(labels.keys() & others.keys()):  # sums follow the order
        expected = s.same_label + s.unexplained * count(category)
        alike += labels[category] * others[category] / expected
    return alike


def _rivals(o: Track, n: Track, absent: Sequence[Absentee]) -> list[Track]:
    """Things of the category of `o`, beside it, that were known before `n`."""
    tracks = (one.track for one in absent if one.track is not o and one.track is not n)
    return [t for t in tracks if t.category == o.category and t.first_seen < n.first_seen]


def in_one_spot(o: Track, n: Track, settings: ObjectSettings) -> bool:
    """Whether `n` stands in the spot of `o` and may have the same category."""
    near = float(np.linalg.norm(o.p_map - n.p_map)) < _gate(o, n, settings)
    return near and not o.plausible.isdisjoint(n.plausible)


def _gate(o: Track, n: Track, s: ObjectSettings) -> float:
    sizes = min(o.size, s.largest) + min(n.size, s.largest)
    return s.stale_gate * (s.gate + s.gate_size * sizes)


def _labels(track: Track) -> dict[str, float]:
    """Probability of each category of a thing that exists."""
    probabilities = category_probabilities(track.log_odds)
    total = sum(probabilities.values()) or 1.0
    return {category: p / total for category, p in probabilities.items() if p > 0.02 * total}


_REAL = 0.5  # least peak existence of a departed object; below it may have been a mistake


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """An object that was found elsewhere."""

    old: Track  # as it was known where it left
    track: Track  # where it was found
    former_iri: str | None  # of that track; None where it was a candidate
    first_seen: float  # [s] of that track
    observations: int
    had_left: bool  # whether it had left the map before it was found


class Departures:
    """Memory of objects that left, and of moves, which a return to the old spot undoes."""

    def __init__(self, settings: ObjectSettings, looks: LookRatio | None = None) -> None:
        self._settings, self._looks = settings, looks
        self._left: list[Track] = []  # latest last
        self._added: list[Track] = []  # by the present frame
        self._dropped: list[Track] = []  # for them, as they were too many
        self._moves: list[Move] = []
        self._latest: list[Move] = []  # of the present frame

    def add(self, lost: Sequence[Track]) -> None:
        """Remember objects that leave the map."""
        self._latest = []
        self._added = [track for track in lost if track.peak >= _REAL]
        self.remember(self._added)
        excess = max(len(self._left) - self._settings.departures, 0)
        self._dropped, self._left = self._left[:excess], self._left[excess:]

    def remember(self, left: Sequence[Track]) -> None:
        """Remember objects that the map says have left, the latest last."""
        self._left += left

    def changes(self, now: float) -> tuple[tuple[DepartedRecord, ...], frozenset[str]]:
        """Records of objects that the present frame, at `now` [s], adds, and IRIs to forget."""
        departed = tuple(t.departed_record(now) for t in self._added if t in self._left)
        return departed, frozenset(track.iri or "" for track in self._dropped)

    @property
    def iris(self) -> frozenset[str]:
        """IRIs of all objects that left."""
        return frozenset(track.iri or "" for track in self._left)

    def forget(self, iris: Collection[str]) -> None:
        """Forget objects that are in the map again."""
        self._left = [track for track in self._left if track.iri not in iris]

    @property
    def tracks(self) -> list[Track]:
        """Tracks of all objects that left, found again or not."""
        return [*self._left, *(move.old for move in self._moves)]

    def forget_unknown(self) -> None:
        """Forget objects without evidence of any category."""
        self._left = [track for track in self._left if track.evidence]
        self._moves = [move for move in self._moves if move.old.evidence]

    def found(
        self,
        absent: Sequence[Absentee],
        appeared: Sequence[Track],
        departed: Departed,
        now: float,
        count: Callable[[str], int],
    ) -> list[Move]:
        """Assign the identity of objects that left to things that `appeared`; returns the moves.

        `absent` are objects of the map that are perhaps not where they were last seen; the other
        arguments are those of `moved_things`.
        """
        left = [Absentee(track, 1.0, looked=True) for track in self._left]
        candidates, s = [*left, *absent], self._settings
        pairs = moved_things(candidates, appeared, departed, now, count, s, self._looks)
        paired = set[int]()
        for old, track in pairs:
            if not paired.isdisjoint(ids := {id(old), id(track)}):
                continue  # in one frame, a thing does not lend its identity and take another one
            paired |= ids
            before, had_left = (track.iri, track.first_seen, track.observations), old in self._left
            self._latest.append(Move(old, track, *before, had_left))
            track.becomes(old)
            self.forget({old.iri or ""})
        self._moves += self._latest
        self._moves = self._moves[-self._settings.departures :]
        return list(self._latest)

    def back(self, track: Track) -> Move | None:
        """Forget and return the move that `track`, which stands in the old spot, disproves."""
        for move in reversed(self._moves):
            if move.track.iri == move.old.iri and in_one_spot(move.old, track, self._settings):
                self._moves.remove(move)
                return move
        return None

    @property
    def joined(self) -> tuple[tuple[str, str], ...]:
        """Former IRI and IRI of the things that the present frame found elsewhere."""
        pairs = ((move.former_iri, move.old.iri) for move in self._latest)
        return tuple((gone, kept) for gone, kept in pairs if gone and kept)

    def undo(self) -> None:
        """Discard the moves of the present frame, which could not be written."""
        for move in self._latest:
            self._moves.remove(move)
            self._left += [move.old] * move.had_left
        self._left = self._dropped + self._left
        self._latest, self._dropped = [], []

    def __bool__(self) -> bool:
        return bool(self._left)
