"""Departures: objects that left their spots, and the moves by which they were found again.

The map holds departed objects too (`kg.maps.facts.departed_objects`), so that they are found after
a restart.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from kg.model.records import DepartedRecord
from mapping.objects.reidentification.moves import (
    Absentee,
    Departed,
    LookRatio,
    in_one_spot,
    moved_things,
)
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

_REAL = 0.5  # least peak existence of a departed object; below it may have been a mistake


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """An object that was found elsewhere."""

    old: Track  # as it was known where it left
    track: Track  # where it was found
    former_iri: str | None  # of that track; None where it was a candidate
    first_seen: float  # [s] of that track
    observations: int


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
        for old, track in pairs:
            self._latest.append(Move(old, track, track.iri, track.first_seen, track.observations))
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
            self._left.append(move.old)
        self._left = self._dropped + self._left
        self._latest, self._dropped = [], []

    def __bool__(self) -> bool:
        return bool(self._left)
