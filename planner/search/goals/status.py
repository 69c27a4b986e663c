"""Status: whether something is present, gone, hidden or was never looked for, and the proof.

`queries/status.rq` answers for each place. This module combines the places. A single object is
looked up in the map, and in its history once it has left the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Literal, cast

from kg.history.reports.comparison import PRESENT
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from planner.freespace.planning_map import Row, number, text_or_none, time_or_none
from planner.search.goals.search_goals import resolve_target

Value = Literal["present", "gone", "hidden", "never looked"]

_PLACES_NAMED: Final = 3  # in a proof, the least viewed ones


@dataclass(frozen=True, slots=True)
class PlaceStatus:
    """Status in one place, or of objects in no place."""

    value: Value
    place: str | None  # IRI
    place_label: str
    object: str | None  # IRI of the object that is present
    label: str
    existence: float | None
    last_seen: datetime | None  # of the object
    viewed_share: float  # of the place's area, 0..1
    closely_viewed_share: float
    last_viewed: datetime | None  # of the place


@dataclass(frozen=True, slots=True)
class Status:
    """Status of a category, or of one object, with its proof in words."""

    target: str
    value: Value
    proof: str
    places: tuple[PlaceStatus, ...]


def status(semantic_map: SemanticMap, what: str, place: str | None = None) -> Status:
    """Status of a category or of an object.

    Args:
        semantic_map: The map.
        what: A category (label, synonym or IRI) or an object (``object/17`` or its IRI).
        place: A place (label, number or IRI) that limits the answer.

    Raises:
        UnknownCategoryError: `what` is neither a category nor an object.
        QueryParameterError: The place is unknown, or the object never was in the map.
    """
    if "object/" in what:
        return _object_status(semantic_map, what)
    category = resolve_target(semantic_map.catalogue, what)
    rows = semantic_map.query("status", category=category.iri).records()
    found = tuple(_place(row) for row in rows)
    if place is not None:
        chosen = semantic_map.resolve("place", place)
        found = tuple(one for one in found if one.place == chosen)
    return Status(category.label, _combined(found), _proof(category.label, found), found)


def _place(row: Row) -> PlaceStatus:
    return PlaceStatus(
        value=cast(Value, row["status"]),
        place=text_or_none(row, "place"),
        place_label=str(row["placeLabel"] or "no place"),
        object=text_or_none(row, "object"),
        label=str(row["label"] or ""),
        existence=None if row["existence"] is None else number(row, "existence"),
        last_seen=time_or_none(row, "lastSeen"),
        viewed_share=_share(row, "viewedShare"),
        closely_viewed_share=_share(row, "closelyViewedShare"),
        last_viewed=time_or_none(row, "lastViewed"),
    )


def _share(row: Row, column: str) -> float:
    return 0.0 if row[column] is None else number(row, column)


def _combined(places: Sequence[PlaceStatus]) -> Value:
    """Status of all places: present if it is in any, gone only if it is in each."""
    values = {one.value for one in places}
    if "present" in values:
        return "present"
    if values == {"gone"}:
        return "gone"
    return "hidden" if values - {"never looked"} else "never looked"


def _proof(label: str, places: Sequence[PlaceStatus]) -> str:
    present = [one for one in places if one.value == "present"]
    if present:
        best = present[0]
        more = f", and {len(present) - 1} more" if len(present) > 1 else ""
        seen = f", last seen {stamp(best.last_seen)}" if best.last_seen else ""
        sure = f"existence {best.existence:.2f}" if best.existence is not None else "asserted"
        return f"{best.label or label} in {best.place_label}, {sure}{seen}{more}"
    if not places:
        return "the map has no places, so the viewed area is unknown"
    least = sorted(places, key=lambda one: one.viewed_share)[:_PLACES_NAMED]
    parts = [
        f"{one.viewed_share:.0%} of {one.place_label}"
        + (f" (last at {stamp(one.last_viewed)})" if one.last_viewed else "")
        for one in least
    ]
    others = len(places) - len(least)
    rest = f", and more of {others} other places" if others else ""
    return f"no {label} was seen, and the robot viewed {', '.join(parts)}{rest}"


def stamp(time: datetime | None) -> str:
    """A time in UTC, to the second; "" for None."""
    return "" if time is None else time.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S")


def _object_status(semantic_map: SemanticMap, what: str) -> Status:
    iri = what if "://" in what else semantic_map.base + what
    places = {place.iri: place for place in semantic_map.places()}
    for record in semantic_map.perceived.objects((iri,)):
        place = places.get(record.place or "")
        views = None if place is None else place.viewed
        seen = datetime.fromtimestamp(record.last_seen, UTC)
        viewed_since = views is not None and views.last > record.last_seen
        value: Value = "gone" if viewed_since else "hidden"
        if record.existence >= PRESENT:
            value = "present"
        where = place.label if place else "no place"
        proof = f"in {where}, existence {record.existence:.2f}, last seen {stamp(seen)}"
        if value != "present" and views is not None:
            viewed = datetime.fromtimestamp(views.last, UTC)
            proof += f"; {where} last viewed {stamp(viewed)}"
        return Status(what, value, proof, ())
    for left in semantic_map.departed((iri,)):
        seen, gone = (datetime.fromtimestamp(t, UTC) for t in (left.last_seen, left.found_gone))
        x, y, _ = left.p_map
        area = next((p.label for p in places.values() if p.area.contains(x, y)), "no place")
        proof = (
            f"left ({x:.2f}, {y:.2f}) in {area}: last seen {stamp(seen)}, found gone {stamp(gone)}"
        )
        return Status(what, "gone", proof, ())
    *_, last = semantic_map.history.events(iri)
    if not any(change.endswith("removed") for change in last.changes):
        raise QueryParameterError(f"{what} is no object; `hereabouts ask MAP objects` lists them")
    when = datetime.fromtimestamp(last.time, UTC)
    by = last.cause.by or last.cause.note or last.cause.kind
    return Status(
        what, "gone", f"left the map by transaction #{last.sequence} ({by}), {stamp(when)}", ()
    )
