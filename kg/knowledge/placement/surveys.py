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

``rooms.csv`` maps the room names of data sets to place categories; a name that is a label or
synonym of a category needs no row. ``similar.csv`` has groups of similar categories. Both lie
beside this file (docs/explanation/placement.md).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.belief_model import SurveyWeights
from kg.model import vocabulary as v
from kg.model.resources import table_rows

_FOLDER: Final = Path(__file__).parent
#: names of rooms of unknown kind
_UNKNOWN: Final = frozenset({"", "other", "unknown", "none"})


@dataclass(frozen=True, slots=True)
class RoomType:
    """Room type: an existing place category, or a new one below a place category."""

    iri: str
    label: str
    below: str | None = None  # IRI of the superclass of a new category; None: it exists


def room_types(name: str, catalogue: Catalogue) -> tuple[RoomType, ...]:
    """Room types of a room name, in any case and with any surrounding space.

    A combined room ("kitchen/living room") and a tie between annotators ("tie: bedroom & office")
    have several types, a room of unknown kind has none. A name without an entry is a new category
    below here:Place.
    """
    name = " ".join(name.split())
    if name.casefold() in _UNKNOWN:
        return ()
    if (one := _one(name, catalogue)) is not None:
        return (one,)
    parts = [part for part in re.split(r"[/&]", name.removeprefix("tie:")) if part.strip()]
    if len(parts) > 1:
        return tuple(kind for part in parts for kind in room_types(part, catalogue))
    return (_new(name, v.PLACE),)


def _one(name: str, catalogue: Catalogue) -> RoomType | None:
    row = _named_rooms().get(name.casefold())
    if row is None or (row["category"] and catalogue.get(row["category"], "place") is None):
        found = catalogue.get(name, "place")
        return None if found is None else RoomType(found.iri, found.label)
    if row["category"]:
        category = catalogue.find(row["category"], "place")
        return RoomType(category.iri, category.label)
    above = catalogue.get(row["below"], "place")
    return _new(name, above.iri if above else v.PLACE)


def _new(name: str, below: str) -> RoomType:
    return RoomType(v.ROOM_TYPE + quote(name.casefold().replace(" ", "-"), safe="-"), name, below)


@cache
def _named_rooms() -> Mapping[str, Mapping[str, str]]:
    return {row["room"]: row for row in table_rows(_FOLDER / "rooms.csv")}


def similarity(
    places: Sequence[str],
    others: Sequence[RoomType],
    catalogue: Catalogue,
    above: Mapping[str, tuple[str, ...]],
) -> NDArray[np.float64]:
    """(m, k): 1 for a place and another room type in one group of ``similar.csv``, else 0.

    A place is also in the groups of its superclasses (`above`: IRI -> itself and all its
    superclasses), and similar to its superclasses and subclasses. Only categories count: wider
    kinds that are not below here:Place, such as here:IndoorPlace, do not make places alike.
    """
    groups = _groups(catalogue)

    def signature(iri: str, ups: Iterable[str]) -> set[str]:
        own = {iri, *(up for up in ups if v.PLACE in above.get(up, ()) and up != v.PLACE)}
        return own | {group for up in own for group in groups.get(up, ())}

    of_places = [signature(iri, above.get(iri, ())) for iri in places]
    of_others = [signature(one.iri, _superclasses(one, above)) for one in others]
    alike = [[float(bool(a & b)) for b in of_others] for a in of_places]
    return np.array(alike).reshape(len(places), len(others))


def _superclasses(room: RoomType, above: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    below = () if room.below is None else (room.below, *above.get(room.below, ()))
    return (*above.get(room.iri, ()), *below)


def _groups(catalogue: Catalogue) -> Mapping[str, set[str]]:
    groups = defaultdict(set)
    for row in table_rows(_FOLDER / "similar.csv"):
        if (category := catalogue.get(row["category"], "place")) is not None:
            groups[category.iri].add(f"group {row['group']}")
    return groups


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
