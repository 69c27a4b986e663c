"""Status: present, gone, looked (none seen), hidden, or never looked for, and the proof.

`queries/status.rq` answers for each place. This module combines the places. A single object is
looked up in the map, and in its history once it has left the map. Only what was really there, by
its greatest existence and its observations, can be gone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Final, Literal, cast

from kg.history.reports.comparison import PRESENT
from kg.history.timestamps import spoken
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError
from kg.model.records import DepartedRecord
from kg.model.shares import chance, percent
from planner.freespace.planning_map import Row, number, text_or_none, time_or_none
from planner.search.goals.place_names import (
    StatedCategory,
    object_named,
    spoken_places,
    stated_categories,
)
from planner.search.goals.search_goals import resolve_target
from planner.search.goals.target_words import undetectable
from planner.settings import BELIEF

Value = Literal["present", "gone", "looked, none seen", "hidden", "never looked"]
NONE_SEEN: Final[Value] = "looked, none seen"

_PLACES_NAMED: Final = 3  # in a proof, the least viewed ones
_LOOKED_AT: Final = 0.05  # viewed share of a place, below which nobody looked, as in `status.rq`
_REAL: Final = 0.8, 3  # greatest existence and observations of what was there, as in `status.rq`
_SOON: Final = 60.0, 10  # [s] until it was found gone, below which more observations are asked
_ALL: Final = 0.995  # viewed share from which on nothing is said of the rest
_NO_ROOM: Final = 0.0005  # chance below which a thing has no room out of view
_LARGE: Final = 0.5  # [m] usual size from which on a thing is noticed from up to 4 m


@dataclass(frozen=True, slots=True)
class PlaceStatus:
    """Status in one place, or of objects in no place."""

    value: Value
    place: str | None  # IRI
    place_label: str
    object: str | None  # IRI of the object that is present, or that was
    label: str
    existence: float | None
    last_seen: datetime | None  # of the object
    viewed_share: float  # of the place's area, 0..1
    closely_viewed_share: float
    last_viewed: datetime | None  # of the place
    found_gone: datetime | None = None  # when its spot was first seen empty
    said: str = ""  # in brackets, who gave the object its category, where a person did
    noticed: float = 0.0  # probability that one thing of the category would have been noticed
    out_of_view: float = 1.0  # probability that one there would stand where nobody viewed


@dataclass(frozen=True, slots=True)
class Status:
    """Status of a category, or of one object, with its proof in words."""

    target: str
    value: Value
    proof: str
    places: tuple[PlaceStatus, ...]
    detectable: bool = True  # False: no category includes such things; the proof has usual places
    out_of_view: str = ""  # the end of the proof that has the chance that one stood out of view

    @property
    def seen(self) -> str:
        """The proof without the chance that one stood out of view."""
        return self.proof.removesuffix(self.out_of_view)


def status(semantic_map: SemanticMap, what: str, place: str | None = None) -> Status:
    """Status of a category or of an object.

    Args:
        semantic_map: The map.
        what: A category (label, synonym or IRI) or an object (``object/17`` or its IRI).
        place: A place (label, number or IRI) that limits the answer.

    Raises:
        UnknownCategoryError: `what` is neither a known word nor an object.
        QueryParameterError: The place is unknown, or the object never was in the map.
    """
    if thing := object_named(semantic_map, what):
        return _object_status(semantic_map, what, thing)
    try:
        category = resolve_target(semantic_map.catalogue, what)
    except UnknownCategoryError:
        unseen = undetectable(semantic_map, what)
        if unseen is None:
            raise
        return Status(unseen.meaning.text, "never looked", unseen.answer, (), detectable=False)
    size = float(semantic_map.resolve("size", category.iri))
    rows = semantic_map.query("status", category=category.iri).records()
    stated = stated_categories(semantic_map)
    found = tuple(_place(row, size, stated) for row in rows)
    if place is not None:
        chosen = semantic_map.resolve("place", place)
        found = tuple(one for one in found if one.place == chosen)
    places = spoken_places(semantic_map)
    named = [replace(o, place_label=places.get(o.place or "", o.place_label)) for o in found]
    value, (proof, hidden) = _combined(found), _proof(category.label, named)
    if category.undetected and value != "present" and "no detector" not in proof:
        proof = f"no detector here can see {category.label}; {proof}"
    return Status(category.label, value, proof + hidden, found, out_of_view=hidden)


def _place(row: Row, size: float, said: Mapping[str, StatedCategory]) -> PlaceStatus:
    by = said.get(str(row["object"]))
    value = cast(Value, row["status"])
    viewed = _share(row, "viewedShare" if size >= _LARGE else "closelyViewedShare")
    return PlaceStatus(
        value=value,
        place=text_or_none(row, "place"),
        place_label=str(row["placeLabel"] or "no place"),
        object=text_or_none(row, "object"),
        label=str(row["label"] or ""),
        existence=None if row["existence"] is None else number(row, "existence"),
        last_seen=time_or_none(row, "lastSeen"),
        viewed_share=_share(row, "viewedShare"),
        closely_viewed_share=_share(row, "closelyViewedShare"),
        last_viewed=time_or_none(row, "lastViewed"),
        found_gone=time_or_none(row, "foundGone"),
        said=by.words(str(row["label"] or "")) if by else "",
        noticed=0.0 if value == "never looked" else BELIEF.noticed * viewed,
        out_of_view=1.0 if row["outOfView"] is None else number(row, "outOfView"),
    )


def _share(row: Row, column: str) -> float:
    return 0.0 if row[column] is None else number(row, column)


def _combined(places: Sequence[PlaceStatus]) -> Value:
    """Status of all places: present or gone if it is so in any, looked only if in each."""
    values = {one.value for one in places}
    for value in ("present", "gone"):
        if value in values:
            return value
    if values == {NONE_SEEN}:
        return NONE_SEEN
    return "hidden" if values - {"never looked"} else "never looked"


def _proof(label: str, places: Sequence[PlaceStatus]) -> tuple[str, str]:
    """Proof of a status, and the chance that one stood out of view, or ""."""
    for value in ("present", "gone"):
        if known := [one for one in places if one.value == value]:
            more = f", and {len(known) - 1} more" if len(known) > 1 else ""
            return _known_proof(label, known[0]) + more, ""
    if not places:
        return "the map has no places, so the viewed area is unknown", ""
    if any(one.value == "never looked" and one.viewed_share >= _LOOKED_AT for one in places):
        return f"no detector that mapped here has a name for {label}, so none could be seen", ""
    least = sorted(places, key=lambda one: one.viewed_share)[:_PLACES_NAMED]
    parts = [f"{percent(one.viewed_share)} of {one.place_label}" for one in least]
    others = len(places) - len(least)
    rest = f", and more of {others} other place{'s' * (others > 1)}" if others else ""
    last = max((one.last_viewed for one in places if one.last_viewed), default=None)
    at = f", last {stamp(last)}" if last else ""
    unseen = max(places, key=lambda one: (one.out_of_view, -one.viewed_share))
    viewed = f"the robot viewed {', '.join(parts)}{rest}{at}"
    if least[0].viewed_share >= _ALL:
        return viewed, ""
    if unseen.out_of_view < _NO_ROOM:
        return viewed, "; no part out of view is large enough for one"
    of = f", most in {unseen.place_label}" if len(places) > 1 else ""
    return viewed, f"; the chance that one stood out of view is {percent(unseen.out_of_view)}{of}"


def _known_proof(label: str, one: PlaceStatus) -> str:
    """Place and time of an object's last sighting, and since when its spot is empty."""
    seen = f", last seen {stamp(one.last_seen)}" if one.last_seen else ""
    if one.value == "gone":
        empty = f", and its spot was seen empty {stamp(one.found_gone)}"
        return f"{one.label or label}{one.said} was in {one.place_label}{seen}{empty}"
    sure = "asserted" if one.existence is None else f"{chance(one.existence)} sure"
    return f"{one.label or label}{one.said} in {one.place_label}, {sure}{seen}"


def stamp(time: datetime | None) -> str:
    """``today at 21:02``: a time as people say it; "" for None."""
    return "" if time is None else spoken(time.timestamp())


def _object_status(semantic_map: SemanticMap, what: str, iri: str) -> Status:
    places = {place.iri: place for place in semantic_map.places()}
    called = spoken_places(semantic_map)
    for record in semantic_map.perceived.objects((iri,)):
        place = places.get(record.place or "")
        views = None if place is None else place.viewed
        seen = datetime.fromtimestamp(record.last_seen, UTC)
        viewed_since = views is not None and views.last > record.last_seen
        value: Value = "hidden"
        if viewed_since:
            value = "gone" if _was_real(semantic_map, iri) else NONE_SEEN
        if record.existence >= PRESENT:
            value = "present"
        where = called[place.iri] if place else "no place"
        stated = stated_categories(semantic_map).get(iri)
        said = f"called {stated.category} by {stated.by}, " if stated else ""
        proof = f"{said}in {where}, {chance(record.existence)} sure, last seen {stamp(seen)}"
        if value != "present" and views is not None:
            viewed = datetime.fromtimestamp(views.last, UTC)
            proof += f"; {where} last viewed {stamp(viewed)}"
        return Status(what, value, proof, ())
    for left in semantic_map.departed((iri,)):
        seen, gone = (datetime.fromtimestamp(t, UTC) for t in (left.last_seen, left.found_gone))
        x, y, _ = left.p_map
        area = next((called[p.iri] for p in places.values() if p.area.contains(x, y)), "no place")
        proof = (
            f"left ({x:.2f}, {y:.2f}) in {area}: last seen {stamp(seen)}, found gone {stamp(gone)}"
        )
        return Status(what, "gone" if was_there(left) else NONE_SEEN, proof, ())
    *_, last = semantic_map.history.events(iri)
    if not any(change.endswith("removed") for change in last.changes):
        raise QueryParameterError(f"{what} is no object; `hereabouts ask MAP objects` lists them")
    when = datetime.fromtimestamp(last.time, UTC)
    by = last.cause.by or last.cause_words
    value = "gone" if _was_real(semantic_map, iri) else NONE_SEEN
    proof = f"left the map by transaction #{last.sequence} ({by}), {stamp(when)}"
    return Status(what, value, proof, ())


def was_there(left: DepartedRecord) -> bool:
    """Whether an object that left its spot was really there, rather than a false detection.

    A false detection is believed after few observations, and refuted as soon as one looks again.
    """
    (least, often), (soon, many) = _REAL, _SOON
    enough = often if left.found_gone - left.last_seen >= soon else many
    return left.peak >= least and left.observations >= enough


def _was_real(semantic_map: SemanticMap, iri: str) -> bool:
    """Whether an object's existence ever was that of a thing that is really there."""
    steps = (
        line.removeprefix("existence ")
        for event in semantic_map.history.events(iri)
        for line in event.changes
        if line.startswith("existence ")
    )
    return any(float(n) >= _REAL[0] for step in steps for n in re.findall(r"\d+\.?\d*", step))
