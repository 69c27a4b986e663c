"""Identity of objects: a thing that appears takes over the IRI of an object that left; merging."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.usual_sizes import UNUSUAL, SizeOf, UsualSize
from mapping.objects.association import boxes_touch, shared_footprint
from mapping.objects.object_cache import ObjectCache
from mapping.objects.reidentification.moves import Absentee, Departed, Departures, LookRatio
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import SEEN_TOGETHER, Track, track_of_departed


class IdentityResolver:
    """Finds departed objects again among the things that appear; `objects` is the map's cache."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        objects: ObjectCache,
        settings: ObjectSettings,
        usual_size: SizeOf,
        looks: LookRatio | None = None,
    ) -> None:
        self._map, self._objects, self._settings = semantic_map, objects, settings
        self._usual_size = usual_size
        self.departures = Departures(settings, looks)
        self._remember(None)

    def refresh(self, touched: frozenset[str]) -> None:
        """Read again the departed objects among the things that other writers `touched`."""
        prefix = self._map.base + "object/"
        known = self.departures.iris
        iris = {iri for iri in touched if iri in known or iri.startswith(prefix)}
        iris -= self._objects.perceived.keys()
        self.departures.forget(touched - iris)
        if iris:
            self.departures.forget(iris - self._remember(iris))

    def _remember(self, iris: Collection[str] | None) -> set[str]:
        """Remember the map's departed objects, all or those of `iris`; returns their IRIs."""
        known, catalogue = self.departures.iris, self._map.catalogue
        records = self._map.departed(iris)
        self.departures.remember(
            [
                track_of_departed(record, self._settings, self._usual_size)
                for record in records
                if record.iri not in known and catalogue.by_iri(record.category) is not None
            ]
        )
        return {record.iri for record in records}

    def resolve(
        self,
        tracks: Sequence[Track],
        new: Sequence[Track],
        touched: Sequence[Track],
        lost: Sequence[Track],
        removed: set[str],
        departed: Departed,
        now: float,
    ) -> tuple[list[Track], list[Track]]:
        """Match the things that appeared with objects that left another spot.

        A matched thing gets the IRI of the object that left.

        Args:
            tracks: all tracks of the mapper.
            new: tracks that are believed since this frame.
            touched: tracks that this frame gave evidence about.
            lost: tracks whose objects are no longer believed.
            removed: IRIs that leave the map with this frame; updated in place.
            departed: probability that an object has left, by track and time.
            now: stamp of the frame [s].

        Returns:
            Tracks to write beside the touched ones, and tracks that lost their IRI to another.
        """
        self.departures.add(
            [t for t in lost if not self._fixed(t) and not self._objects.asserted_absent(t.iri)]
        )
        gone = {id(track) for track in lost}
        to_write = self._returned(new, [track for track in tracks if id(track) not in gone])
        min_absence = self._settings.left
        left = [t for t in touched if t.iri and t.absent >= min_absence and id(t) not in gone]
        if not (new or lost or left) or not (left or self.departures):
            return to_write, []
        objects = [t for t in tracks if t.iri and id(t) not in gone]
        absentees = [
            Absentee(t, t.absent, looked=t.absent >= min_absence)
            for t in objects
            if not self._fixed(t)
        ]
        appeared = [
            t for t in objects if t.existence >= 0.5 and not self._objects.has_assertions(t.iri)
        ]
        appeared += [t for t in new if t.iri is None]
        count = Counter(track.category for track in objects)
        replaced = list[Track]()
        for move in self.departures.found(absentees, appeared, departed, now, count.__getitem__):
            assert move.old.iri is not None
            removed.discard(move.old.iri)
            if move.former_iri is not None:
                removed.add(move.former_iri)
            replaced.append(move.old)
            to_write.append(move.track)
        return to_write, replaced

    def _returned(self, new: Sequence[Track], tracks: Sequence[Track]) -> list[Track]:
        """Undo moves whose object appears at its old spot; returns the tracks of these moves.

        Each of these tracks gets its former IRI again, or a new one.
        """
        others, present = list[Track](), {id(track) for track in tracks}
        for track in new:
            move = self.departures.back(track)
            if move is None or id(move.track) not in present or self._fixed(move.track):
                continue
            other = move.track
            track.becomes(other)
            other.iri = move.former_iri or self._map.new_object_iri()
            other.written, other.first_seen = None, move.first_seen
            other.observations -= move.old.observations
            others.append(other)
        return others

    def _fixed(self, track: Track) -> bool:
        """Whether people assert where an object is, or that it is there."""
        present = self._objects.asserted_present(track.iri)
        return present or self._objects.asserted(track.iri)[0] is not None


_LARGE = 1.2  # [m] usual size from which things are seen in parts
_PARTS = 0.1  # greatest shared footprint of two large things of one category
_TOLERANCE = 1.15  # of the usual size
_LIKELY = 0.5  # existence


def duplicates(
    touched: Sequence[Track], tracks: Sequence[Track], usual: SizeOf, settings: ObjectSettings
) -> list[tuple[Track, Track]]:
    """Pairs (kept, absorbed) of tracks that are one thing, each with one of the `touched` tracks.

    Objects of the map absorb candidates; tracks that were once likely absorb others; older tracks
    absorb younger ones.
    """
    if not touched or len(tracks) < 2:
        return []
    positions = np.array([track.p_map for track in tracks])
    lows, highs = np.array([t.low for t in tracks]), np.array([t.high for t in tracks])
    found, gone = list[tuple[Track, Track]](), set[int]()
    for track in touched:
        if id(track) in gone:
            continue
        distances = np.linalg.norm(positions - track.p_map, axis=1)
        # parts of one thing lie up to 2 m apart
        near = (distances < 2.0) | boxes_touch(track.low, track.high, lows, highs)
        for index in np.nonzero(near)[0]:
            other = tracks[int(index)]
            if other is track or id(other) in gone or id(track) in gone:
                continue
            if other.category != track.category and distances[index] >= 0.3 * settings.largest:
                continue
            if same_thing(track, other, usual, settings):
                kept, absorbed = sorted((track, other), key=_seniority)
                found.append((kept, absorbed))
                gone.add(id(absorbed))
    return found


def _seniority(track: Track) -> tuple[bool, bool, float]:
    """Sort key: objects of the map first, then tracks that were once likely, then older ones."""
    return track.iri is None, track.peak < _LIKELY, track.first_seen


def same_thing(a: Track, b: Track, usual: SizeOf, s: ObjectSettings) -> bool:
    """Whether two tracks are one thing."""
    distance = float(np.linalg.norm(a.p_map - b.p_map))
    sizes = min(a.size, s.largest), min(b.size, s.largest)
    apart = a.together.get(b.number, 0) >= SEEN_TOGETHER
    if a.category != b.category:
        return not apart and distance < 0.3 * min(sizes)
    expected = usual(a.category) or UNUSUAL
    if distance < max(s.separation * expected.width, 0.1 * max(sizes)):
        return True
    shared = shared_footprint(a.low, a.high, b.low, b.high)
    max_shared = _PARTS if expected.longest >= _LARGE else s.interpenetration
    if max(sizes) > UNUSUAL.longest and shared > max_shared:
        return True
    if apart:
        return False
    near = distance < 0.1 + s.same_place * sum(sizes) / 2
    return near or shared > s.overlap or _parts_of_one(a, b, expected)


def _parts_of_one(a: Track, b: Track, expected: UsualSize) -> bool:
    """Whether both are parts of one large thing: their common box is no larger than one of them.

    Beds, tables and couches are seen in parts, cut by the image's border.
    """
    if expected.longest < _LARGE:
        return False
    low, high = np.minimum(a.low, b.low), np.maximum(a.high, b.high)
    return float((high - low)[:2].max()) < _TOLERANCE * expected.longest
