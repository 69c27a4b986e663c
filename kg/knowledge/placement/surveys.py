"""Shipped surveys of rooms: numbers of rooms of a kind with and without an object.

`tables/room_statistics.csv` has the counts of BEHAVIOR-1K's homes and of COCO's photographs (NOTICE
names authors and licences). A photograph shows part of a room and was taken for its objects, so the
counts are features of a regression, not rates. Each survey has four features for a pair of object
and place:

    c     1 if the survey covers the object, else 0
    rate  c (logit m + 2), with the mean rate m of the object over all kinds of place
    d     c if the survey covers the kind of place, its nearest superclass, or a similar kind
          (`similar.csv`), else 0
    lift  d (logit((with + 4 m) / (rooms + 4)) - logit m)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.belief_model import SurveyWeights
from kg.knowledge.placement.rooms import RoomType, room_types, similarity
from kg.model import vocabulary as v
from kg.model.resources import table_rows

TABLE: Final = Path(__file__).with_name("tables") / "room_statistics.csv"

#: the survey of whole homes
HOMES: Final = "BEHAVIOR-1K homes"

Matrix = NDArray[np.float64]

_PRIOR_ROOMS: Final = 4.0  # strength of a survey's mean rate for one kind of place [rooms]
_RATE_BOUNDS: Final = (0.003, 0.97)
_CENTRE: Final = 2.0  # log-odds of rates are about -2 on average


@dataclass(frozen=True, slots=True)
class SurveyFeatures:
    """Features of n objects in m places, and the underlying counts."""

    name: str
    covers_object: Matrix  # c (n, m)
    object_rate: Matrix  # rate (n, m)
    covers_place: Matrix  # d (n, m)
    lift: Matrix  # (n, m)
    rooms: Matrix  # (n, m) rooms that `lift` counts
    rooms_with: Matrix  # (n, m)

    def log_odds(self, weights: SurveyWeights) -> Matrix:
        """(n, m) contribution of the survey to the log-odds of a pair."""
        return np.asarray(
            weights.covers_object * self.covers_object
            + weights.object_rate * self.object_rate
            + weights.covers_place * self.covers_place
            + weights.lift * self.lift
        )


@dataclass(frozen=True, slots=True)
class _Survey:
    """Counts (objects, places) by label."""

    objects: tuple[str, ...]
    places: tuple[str, ...]
    rooms: Matrix
    rooms_with: Matrix


def survey_features(
    objects: Sequence[str],
    places: Sequence[str],
    catalogue: Catalogue,
    above: Mapping[str, tuple[str, ...]],
) -> tuple[SurveyFeatures, ...]:
    """Features of each shipped survey for categories by IRI (`above`: IRI -> all superclasses).

    An object outside of a survey has the counts of its nearest superclass in the survey.
    """
    return tuple(
        _features(name, survey, objects, places, catalogue, above)
        for name, survey in _surveys().items()
    )


def _features(
    name: str,
    survey: _Survey,
    objects: Sequence[str],
    places: Sequence[str],
    catalogue: Catalogue,
    above: Mapping[str, tuple[str, ...]],
) -> SurveyFeatures:
    found = [catalogue.get(label, "object") for label in survey.objects]
    number = {category.iri: row for row, category in enumerate(found) if category is not None}
    rows = [_nearest(iri, number, above) for iri in objects]
    looked_for = np.array([[float(row is not None)] for row in rows]).reshape(len(rows), 1)
    chosen = [0 if row is None else row for row in rows]
    spread = _columns(survey.places, places, catalogue, above)
    rooms, held = (np.asarray((x @ spread)[chosen]) for x in (survey.rooms, survey.rooms_with))
    mean = np.clip(
        ((survey.rooms_with + 0.25) / (survey.rooms + 0.5)).mean(1, keepdims=True), *_RATE_BOUNDS
    )[chosen]
    c = np.broadcast_to(looked_for, rooms.shape)
    d = c * (rooms > 0)
    rate = (held + _PRIOR_ROOMS * mean) / (rooms + _PRIOR_ROOMS)
    return SurveyFeatures(
        name=name,
        covers_object=c,
        object_rate=c * (logit(mean) + _CENTRE),
        covers_place=d,
        lift=d * (logit(rate) - logit(mean)),
        rooms=d * rooms,
        rooms_with=d * held,
    )


def room_frequencies(places: Sequence[str], catalogue: Catalogue) -> NDArray[np.float64]:
    """(m,) probability that a room of a home has each category (by IRI), adding up to 1.

    The source is the shipped survey of whole homes, with one more room of each category
    (smoothing). A kind of room counts for its own category only.
    """
    homes = _surveys()[HOMES]
    counts = np.ones(len(places))
    column = {iri: n for n, iri in enumerate(places)}
    for label, rooms in zip(homes.places, homes.rooms.max(axis=0), strict=True):
        at = column.get(_kind(label, catalogue).iri)
        if at is not None:
            counts[at] += rooms
    return np.asarray(counts / counts.sum(), np.float64)


def logit(p: ArrayLike) -> Matrix:
    """ln(p / (1 - p)), bounded for p at 0 or 1."""
    clipped = np.clip(p, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(clipped / (1 - clipped)))


def _nearest(
    iri: str, number: Mapping[str, int], above: Mapping[str, tuple[str, ...]]
) -> int | None:
    """The number of a class, or of its most specific numbered superclass."""
    ups = [up for up in (iri, *above.get(iri, ())) if up in number]
    if iri in number or not ups:
        return number.get(iri)
    return number[max(ups, key=lambda up: (len(above.get(up, ())), up))]


def _columns(
    counted: Sequence[str],
    places: Sequence[str],
    catalogue: Catalogue,
    above: Mapping[str, tuple[str, ...]],
) -> Matrix:
    """(counted, m) 1 if the rooms of a counted kind of place count for a place."""
    kinds = [_kind(label, catalogue) for label in counted]
    number = {kind.iri: n for n, kind in enumerate(kinds)}
    found = similarity(places, kinds, catalogue, above).T
    for column, iri in enumerate(places):
        row = None if iri == v.PLACE else _nearest(iri, number, above)
        if iri == v.PLACE or row is not None:
            found[:, column] = 0
        if row is not None:
            found[row, column] = 1
    return found


def _kind(label: str, catalogue: Catalogue) -> RoomType:
    """The room type of a label, with an empty IRI if the catalogue lacks it."""
    return next(iter(room_types(label, catalogue)), RoomType("", label))


@cache
def _surveys() -> Mapping[str, _Survey]:
    rows = table_rows(TABLE)
    return {
        name: _survey([row for row in rows if row["source"] == name])
        for name in dict.fromkeys(row["source"] for row in rows)
    }


def _survey(rows: Sequence[Mapping[str, str]]) -> _Survey:
    objects = tuple(dict.fromkeys(row["object"] for row in rows))
    places = tuple(dict.fromkeys(row["place"] for row in rows))
    rooms, held = np.zeros((2, len(objects), len(places)))
    for row in rows:
        cell = objects.index(row["object"]), places.index(row["place"])
        rooms[cell], held[cell] = float(row["rooms"]), float(row["rooms_with"])
    return _Survey(objects, places, rooms, held)
