"""Place mapper: belief over the categories of each place, from its views (section 3.3.2)."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.records import PlaceRecord
from mapping.frames.projection import map_points
from mapping.labels.label_resolver import LabelResolver
from mapping.labels.label_table import LabelTable
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.belief_filters import bayes_update, mean_update, with_prior
from mapping.reference.settings import INDOOR_CATEGORIES, ReferenceSettings
from mapping.reference.viewpoint_gate import main_owner, repeats_view, unknown_share
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
        # prior knowledge of the categories leaves no room for new ones
        unknown = "ignore" if settings.indoor_prior else settings.unknown_labels
        self.labels = LabelResolver(
            semantic_map, "place", table=labels, unknown=unknown, model=model
        )
        self._categories = self._allowed()

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
            self._learn_categories()
        record = self._places[iri]
        scores = self._scores(scene)
        if scores is None:
            return record
        belief = self._updated(self._belief(record), record.views, scores)
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

    def step(self, frame: Frame, scene: SceneScores) -> tuple[PlaceRecord, ...]:
        """Add `view` to the place that `frame` shows; nothing if it shows no single place."""
        iri = self.viewed_place(frame)
        return () if iri is None else (self.view(iri, frame, scene),)

    def _belief(self, record: PlaceRecord) -> dict[str, float]:
        """Belief so far; the registry's, where others changed it since the last view."""
        if self._kept.get(record.iri) is record.from_views:
            return self._beliefs[record.iri]
        return dict(record.from_views)

    def _updated(
        self, belief: dict[str, float], views: int, scores: dict[str, float]
    ) -> dict[str, float]:
        if self._settings.belief_filter == "mean":
            return mean_update(belief, views, scores)
        return bayes_update(belief, scores, self._categories, self._settings.bayes_floor)

    def _scores(self, scene: SceneScores) -> dict[str, float] | None:
        """Scores by category IRI; None where none is left."""
        scores: dict[str, float] = {}
        for label, probability in scene.probability.items():
            iri = self.labels.category(label)
            if iri is not None:
                scores[iri] = scores.get(iri, 0.0) + probability
        if self._settings.indoor_prior:
            return with_prior(scores, self._categories)
        return scores or None

    def _learn_categories(self) -> None:
        self._catalogue = self._map.catalogue
        self._categories = self._allowed()
        for iri, belief in self._beliefs.items():
            known = {c: p for c, p in belief.items() if self._catalogue.by_iri(c) is not None}
            self._beliefs[iri] = known

    def _allowed(self) -> frozenset[str]:
        """Categories that a place may have, by IRI."""
        if self._settings.indoor_prior:
            return frozenset(self._catalogue.find(c, kind="place").iri for c in INDOOR_CATEGORIES)
        return frozenset(c.iri for c in self._catalogue.categories if c.kind == "place")
