"""Place mapper: belief over the categories of each place, by views and objects (section 3.3.2)."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.placement.table import PlacementTable, table_of
from kg.maps.semantic_map import SemanticMap
from kg.model.records import FloorTile, MapUpdate, ObjectRecord, PlaceRecord
from mapping.frames.projection import map_points
from mapping.labels.label_resolver import LabelResolver, LabelTable
from mapping.occupancy.mapped_floor import FloorView
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.room_segmentation import SegmentationSettings
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.belief_filters import (
    main_owner,
    mean_update,
    repeats_view,
    unknown_share,
)
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame, SceneScores


class PlaceMapper:
    """Place mapper: updates beliefs over place categories with scene scores.

    Views and beliefs come from the graph (through `places`) and go back into it; the latest poses
    are kept for this run only. `labels` resolves the network's labels; the probability of a label
    without a category is dropped, and the others are not scaled up.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        places: PlaceRegistry,
        settings: ReferenceSettings,
        *,
        model: str = "",
        labels: LabelTable | None = None,
    ) -> None:
        self._map = semantic_map
        self._catalogue = semantic_map.catalogue
        self._places = places
        self._settings = settings
        self._beliefs: dict[str, dict[str, float]] = {}  # unrounded, of this run's views
        self._kept: dict[str, Mapping[str, float]] = {}  # the same, as the registry has them
        self._history: dict[str, deque[NDArray[np.float64]]] = {}
        self.labels = LabelResolver(
            semantic_map, "place", table=labels, unknown=settings.unknown_labels, model=model
        )

    def viewed_place(self, frame: Frame) -> str | None:
        """IRI of the place that `frame` counts for, or None; needs no network.

        Enough depth, 75 % of it in one place, and no repeated pose.
        """
        s = self._settings
        if unknown_share(frame, s.stride) > s.max_unknown_view:
            return None
        owner = main_owner(self._places.owners(map_points(frame, s.stride)), s.purity)
        if owner is None:
            return None
        iri = self._places.places()[owner].iri
        history = self._history.get(iri, ())
        if repeats_view(frame.T_map_cam, history, s.history_distance, s.history_angle):
            return None
        return iri

    def view(self, iri: str, frame: Frame, scene: SceneScores) -> PlaceRecord:
        """Update the belief of place `iri` with the scene scores of `frame`; the new record."""
        least = self._settings.least_scene
        self.labels.learn(label for label, p in scene.probability.items() if p >= least)
        if self._catalogue is not self._map.catalogue:  # the ontology has changed
            self._forget_categories()
        record = self._places[iri]
        scores = self._scores(scene)
        if not scores:
            return record
        belief = mean_update(self._belief(record), record.views, scores)
        self._beliefs[iri] = belief
        history = self._history.setdefault(iri, deque(maxlen=self._settings.history_length))
        history.append(frame.T_map_cam)
        kept = {c: p for c, p in belief.items() if p >= self._settings.least_belief}
        self._kept[iri] = kept
        updated = replace(
            record, views=record.views + 1, beliefs=kept, scene_beliefs={}, evidence_objects=()
        )
        self._places.put(updated)
        return updated

    def _belief(self, record: PlaceRecord) -> dict[str, float]:
        """Belief so far; the registry's, where others changed it since the last view."""
        if self._kept.get(record.iri) is record.from_views:
            return self._beliefs[record.iri]
        return dict(record.from_views)

    def _scores(self, scene: SceneScores) -> dict[str, float]:
        """Scores by category IRI."""
        scores: dict[str, float] = {}
        for label, probability in scene.probability.items():
            iri = self.labels.category(label)
            if iri is not None:
                scores[iri] = scores.get(iri, 0.0) + probability
        return scores

    def _forget_categories(self) -> None:
        """Forget beliefs in categories that left the ontology."""
        self._catalogue = self._map.catalogue
        for iri, belief in self._beliefs.items():
            known = {c: p for c, p in belief.items() if self._catalogue.by_iri(c) is not None}
            self._beliefs[iri] = known


class ViewedFloor:
    """Floor that a robot's camera had in view, and the places on it; writes nothing.

    Views of floor that no depth image has shown do not count.
    """

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._settings = OccupancySettings()
        self._occupancy = OccupancyMap(semantic_map, self._settings)
        self._places = PlaceRegistry(semantic_map, recording=None)

    def add(self, views: Sequence[FloorView], height: float, stamp: float) -> None:
        """Add the floor in view of a robot at height `height` [m] at `stamp` [s]."""
        points = [self._points(view) for view in views if len(view.p_map)]
        if points:
            p_map, close = (np.concatenate(part) for part in zip(*points, strict=True))
            self._occupancy.refresh()
            self._occupancy.add_views(p_map, close, height, stamp)

    def _points(self, view: FloorView) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Points of the remembered views' grid, and whether each is viewed from close by."""
        s = self._settings
        parts = max(int(np.ceil(view.cell / (s.cell * s.view) - 1e-6)), 1)  # of a cell's side
        steps = ((np.arange(parts) + 0.5) / parts - 0.5) * view.cell
        offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        p_map = (view.p_map[:, None, :] + offsets).reshape(-1, 2)
        return p_map, np.repeat(view.metres <= s.close, parts**2)

    def take_changed(self, stamp: float) -> tuple[tuple[FloorTile, ...], tuple[PlaceRecord, ...]]:
        """Tiles that have changed enough, to be written at `stamp` [s], and their places."""
        return self._with_places(self._occupancy.take_changed(stamp))

    def take_rest(self) -> tuple[tuple[FloorTile, ...], tuple[PlaceRecord, ...]]:
        """Tiles that have changed at all, and their places."""
        return self._with_places(self._occupancy.take_rest())

    def _with_places(
        self, floor: tuple[FloorTile, ...]
    ) -> tuple[tuple[FloorTile, ...], tuple[PlaceRecord, ...]]:
        if not floor:
            return (), ()
        self._places.refresh()
        update_place_views(self._places, self._occupancy, floor)
        return floor, self._places.take_changed()

    def undo(self, update: MapUpdate) -> None:
        """Mark tiles and places of `update` as changed again, which could not be written."""
        self._occupancy.undo(update.floor)
        self._places.undo(update.places)


_WALLS: Final = SegmentationSettings().walls  # [m] that outlines of found rooms reach into walls


def update_place_views(
    places: PlaceRegistry, occupancy: OccupancyMap, floor: Sequence[FloorTile]
) -> None:
    """Update the viewed shares of the places in which the changed tiles, `floor`, lie."""
    if not floor:
        return
    for place in places.places():
        storey = occupancy.touches(place.area, floor)
        walls = _WALLS if place.from_floor else 0.0
        viewed = None if storey is None else occupancy.views(place.area, storey, walls)
        if viewed is not None and viewed != place.viewed:
            places.put(replace(place, viewed=viewed))


_Presence = Mapping[str, float]  # category IRI -> probability that the place holds one


class ObjectEvidence:
    """Fuses the evidence of objects with the beliefs that the views of each place give."""

    def __init__(
        self, semantic_map: SemanticMap, places: PlaceRegistry, settings: ReferenceSettings
    ) -> None:
        self._map, self._places, self._settings = semantic_map, places, settings
        self._catalogue = semantic_map.catalogue
        self._table: PlacementTable = table_of(semantic_map.ontology.quads())
        self._frequencies = self._table.room_frequencies
        self._done: dict[str, tuple[_Presence, _Presence, tuple[str, ...]]] = {}

    def update(self, objects: Iterable[ObjectRecord]) -> None:
        """Update the belief of every place from its views and from all `objects` in it."""
        self._refresh_ontology()
        inside: dict[str, list[ObjectRecord]] = defaultdict(list)
        for record in objects:
            if record.place is not None and record.existence > 0:
                inside[record.place].append(record)
        for place in self._places.places():
            evidence = [r for r in inside[place.iri] if r.category in self._table.objects]
            self._fuse(place, evidence)

    def _fuse(self, place: PlaceRecord, evidence: list[ObjectRecord]) -> None:
        if not evidence:
            if place.evidence_objects:
                alone = replace(
                    place, beliefs=place.from_views, scene_beliefs={}, evidence_objects=()
                )
                self._places.put(alone)
            return
        present, objects = presence(evidence), tuple(record.iri for record in evidence)
        views = place.from_views
        if place.evidence_objects and self._done.get(place.iri) == (present, views, objects):
            return
        self._done[place.iri] = present, views, objects
        beliefs = self.fused(present, views)
        self._places.put(
            replace(place, beliefs=beliefs, scene_beliefs=views, evidence_objects=objects)
        )

    def fused(self, present: _Presence, views: Mapping[str, float]) -> dict[str, float]:
        """Posterior p(category | views and objects) by IRI, of the categories worth keeping.

        Args:
            present: probability that the place holds an object of each category.
            views: belief from the views; empty where there are none.
        """
        prior = self.prior(views)
        weight = self._settings.objects_weight
        weighed = {category: weight * chance for category, chance in present.items()}
        posterior = self._table.place_posterior(weighed, prior=prior)
        return {c: p for c, p in posterior.items() if p >= self._settings.least_belief}

    def prior(self, views: Mapping[str, float]) -> dict[str, float]:
        """Prior probability of each category IRI from views and room frequencies; sums to 1.

        Without views the frequencies alone. With them, a share of the views' belief is left to the
        frequencies, since a network has few place categories, and the rest is weighed by them.
        """
        s, frequency = self._settings, self._frequencies
        total = sum(views.values())
        if total <= 0:
            return dict(frequency)
        weighed = {
            c: (s.scene_trust * views.get(c, 0.0) / total + (1 - s.scene_trust) * f)
            * f**s.frequency_weight
            for c, f in frequency.items()
        }
        whole = sum(weighed.values())
        return {c: p / whole for c, p in weighed.items()}

    def _refresh_ontology(self) -> None:
        if self._catalogue is not self._map.catalogue:
            self._catalogue = self._map.catalogue
            self._table = table_of(self._map.ontology.quads())
            self._frequencies = self._table.room_frequencies
            self._done.clear()


def presence(objects: Iterable[ObjectRecord]) -> dict[str, float]:
    """Presence probability of each category, in steps of 0.01: at least one object is there."""
    absent: dict[str, float] = {}
    for record in objects:
        chance = min(max(record.existence, 0.0), 1.0)
        absent[record.category] = absent.get(record.category, 1.0) * (1 - chance)
    return {category: round(1 - rest, 2) for category, rest in sorted(absent.items())}
