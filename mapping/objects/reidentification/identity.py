"""Identity of objects: a thing that appears takes over the IRI of an object that left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

from kg.maps.semantic_map import SemanticMap
from mapping.objects.object_cache import ObjectCache
from mapping.objects.reidentification.departures import Departures
from mapping.objects.reidentification.moves import Absentee, Departed, LookRatio
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track, track_of_departed
from mapping.objects.usual_sizes import SizeOf


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
        to_write = self._returned(new, tracks)
        gone = {id(track) for track in lost}
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
