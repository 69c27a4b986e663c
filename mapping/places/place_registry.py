"""Place registry: the places of a map, the place of a point, and each place's belief."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.map_extent import check_positions
from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import ExternalChanges
from kg.model.areas import Rectangle
from kg.model.errors import LayoutError, UnknownCategoryError
from kg.model.records import PlaceRecord
from mapping.frames.projection import bounds
from mapping.places.layout import Layout, LayoutPlace


class PlaceRegistry:
    """All places of a map, those of this run first; a cache that the graph can rebuild.

    With a layout, its places are this run's places. Without one, the run has a single place,
    labelled with the recording's name, that grows with the viewed area; with `find` only until
    places are found in the floor. With `recording` None the run has no places of its own. Places of
    other runs follow, with their views and beliefs. All are as perception believes them; `refresh`
    reads changes of other writers.

    Raises LayoutError where the layout names a category that the ontology does not have, and for a
    place that is too far away to belong to the map.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        layout: Layout | None = None,
        *,
        recording: str | None = "extent",
        find: bool = False,
    ) -> None:
        self._map = semantic_map
        self._watch = ExternalChanges(semantic_map)
        known = {record.iri: record for record in semantic_map.perceived.places()}
        self.revision = 0  # counts the changes of any area
        self._recording, self._find = recording or "", find
        self._growing = (
            None
            if layout or recording is None
            else _extent_iri(semantic_map, known.values(), recording)
        )
        self._asserted = areas_asserted(semantic_map)
        given = _layout_places(semantic_map, layout.places, known) if layout else {}
        given |= {
            iri: record.with_area(known[iri].area)
            for iri, record in given.items()
            if iri in self._asserted
        }
        if self._growing in known:
            given = {self._growing: known[self._growing]}
        self._places = self._ordered(
            given | {iri: r for iri, r in known.items() if iri not in given}
        )
        self._changed = {iri for iri, record in given.items() if record != known.get(iri)}

    def places(self) -> tuple[PlaceRecord, ...]:
        """Every place, in the order in which they claim points."""
        return tuple(self._places.values())

    def refresh(self) -> None:
        """Read changes of other writers since the last call; cheap where there are none."""
        touched = self._watch.take()
        if not touched:
            return
        known = {record.iri: record for record in self._map.perceived.places()}
        self._changed -= touched
        before = self._places
        places = {iri: r for iri, r in before.items() if iri in known or iri not in touched}
        places |= {iri: record for iri, record in known.items() if iri in touched}
        self._places = self._ordered(places)
        self.revision += [*self._places.items()] != [*before.items()]

    def _ordered(self, places: dict[str, PlaceRecord]) -> dict[str, PlaceRecord]:
        """Places with an asserted area first, since they claim their points before all others."""
        self._asserted = areas_asserted(self._map)
        return dict(sorted(places.items(), key=lambda place: place[0] not in self._asserted))

    def put(self, record: PlaceRecord) -> None:
        """Store a record of a place, if it differs from the former one."""
        old = self._places.get(record.iri)
        if old == record:
            return
        self._places[record.iri] = record
        self._changed.add(record.iri)
        if old is None or old.area != record.area:
            self.revision += 1

    def remove(self, iris: Iterable[str]) -> None:
        """Forget places that left the map."""
        for iri in iris:
            del self._places[iri]
            self._changed.discard(iri)
            self.revision += 1

    def __getitem__(self, iri: str) -> PlaceRecord:
        return self._places[iri]

    def take_changed(self) -> tuple[PlaceRecord, ...]:
        """The records that changed since the last call, for the graph."""
        changed = tuple(r for iri, r in self._places.items() if iri in self._changed)
        self._changed.clear()
        return changed

    def undo(self, records: Iterable[PlaceRecord]) -> None:
        """Mark records that could not be written as changed again."""
        self._changed |= {record.iri for record in records if record.iri in self._places}

    def observe(self, points: NDArray[np.float64]) -> None:
        """Extend the growing place, where there is one, by `points` (n, 3) [m] of the map."""
        if self._growing is None or not self.grows:
            return
        old = self._places.get(self._growing)
        before = old.area if old else None
        extent = extended(before, points)
        if extent is None:
            return
        new = old or PlaceRecord(self._growing, self._recording, 0.0, 0.0, 0.0, 0.0)
        first = new.with_area(extent)
        if first == old:
            return
        self._places = self._ordered({self._growing: first} | self._places | {self._growing: first})
        self._changed.add(self._growing)
        self.revision += 1

    @property
    def grows(self) -> bool:
        """Whether a place grows with what is viewed, since neither people nor the floor set it."""
        if self._growing is None or self._growing in self._asserted:
            return False
        return not (self._find and any(place.from_floor for place in self._places.values()))

    def owners(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Index into `places()` of the first place that holds each point (n, 2 or more); or -1."""
        owner = np.full(len(points), -1, dtype=np.intp)
        left = np.arange(len(points))
        for index, place in enumerate(self._places.values()):
            inside = place.area.contains_each(points[left, 0], points[left, 1])
            owner[left[inside]] = index
            left = left[~inside]
        return owner

    def at(self, p_map: NDArray[np.float64]) -> str | None:
        """IRI of the place that holds `p_map` (3,) [m], or None."""
        owner = int(self.owners(p_map[None, :])[0])
        return None if owner < 0 else self.places()[owner].iri


def areas_asserted(semantic_map: SemanticMap) -> set[str]:
    """IRIs of the places whose areas persons have asserted."""
    claims = semantic_map.assertions.all()
    return {claim.subject for claim in claims if claim.property == "area"}


def _extent_iri(semantic_map: SemanticMap, known: Iterable[PlaceRecord], recording: str) -> str:
    """IRI of the recording's own growing place, of an earlier run or the first free number."""
    taken = set()
    for record in known:
        if record.label == recording:
            return record.iri
        taken.add(record.iri)
    number = 1
    while semantic_map.place_iri(number) in taken:
        number += 1
    return semantic_map.place_iri(number)


def _layout_places(
    semantic_map: SemanticMap, places: Sequence[LayoutPlace], known: dict[str, PlaceRecord]
) -> dict[str, PlaceRecord]:
    """Layout places by IRI, with the map's beliefs so far.

    Raises LayoutError for a place that is too far away to belong to the map.
    """
    given = {}
    for place in places:
        corners = [(place.area.xmin, place.area.ymin), (place.area.xmax, place.area.ymax)]
        check_positions(semantic_map.engine, corners, f"corner of {place.label}", LayoutError)
    for place in places:
        iri = semantic_map.place_iri(place.number)
        believed = known.get(iri)
        if believed is None or not (believed.views > 0 or believed.evidence_objects):
            beliefs = _stated_category(place, semantic_map.catalogue)
            believed = PlaceRecord(iri, "", 0.0, 0.0, 0.0, 0.0, len(beliefs), beliefs)
        given[iri] = replace(believed, label=place.label).with_area(place.area)
    return given


def _stated_category(place: LayoutPlace, catalogue: Catalogue) -> dict[str, float]:
    """A category that the layout states counts as one certain view."""
    if place.category is None:
        return {}
    try:
        return {catalogue.find(place.category, kind="place").iri: 1.0}
    except UnknownCategoryError as error:
        raise LayoutError(f"{place.label} has the category: {error}") from error


#: [m] sides lie on this grid, so that the place is rewritten when it grows by a step, not a pixel
STEP: Final = 0.5
#: share of a view's points left out at each end: outliers of depth must not stretch the place
TRIM: Final = 0.02


def trimmed_extent(points: NDArray[np.float64]) -> Rectangle | None:
    """Trimmed bounding rectangle of `points` (n, 2 or more) [m], rounded outward to the grid.

    None without points.
    """
    if len(points) == 0:
        return None
    low, high = bounds(points[:, :2], TRIM)
    low, high = np.floor(low / STEP) * STEP, np.floor(high / STEP) * STEP + STEP
    return Rectangle(float(low[0]), float(high[0]), float(low[1]), float(high[1]))


def extended(extent: Rectangle | None, points: NDArray[np.float64]) -> Rectangle | None:
    """Union of `extent` and the trimmed extent of `points` (n, 2 or more) [m]: it only grows."""
    viewed = trimmed_extent(points)
    if extent is None or viewed is None:
        return extent or viewed
    return extent.union(viewed)
