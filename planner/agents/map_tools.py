"""Tools that read a map: its objects, places, status and explanations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Final

from pydantic import Field

from kg.history.timestamps import iso
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.records import PlaceRecord
from kg.serving.workers.limited_queries import LimitedQueries
from planner.agents import answers as a
from planner.agents.map_context import MapContext, number_or_none, time_or_none
from planner.freespace.planning_map import Row
from planner.search.goals.known_objects import KnownObject, known_objects
from planner.search.goals.search_goals import whereabouts
from planner.search.goals.status import PlaceStatus, status
from planner.search.goals.targets import resolve

Word = Annotated[str, Field(min_length=1, max_length=100)]
ThingName = Annotated[str, Field(min_length=1, max_length=300, description="object/17 or its IRI")]
Limit = Annotated[int, Field(ge=1, le=100, description="maximum number to list")]
Metres = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False, description="map frame, m")]
Least = Annotated[float, Field(ge=0, le=1, description="minimum existence of objects")]
Radius = Annotated[float, Field(gt=0, le=1000, description="metres along the floor")]

_SAME_SPOT: Final = 0.01  # [m] radius around the position of an object


class MapTools:
    """The reading tools of one map. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext, queries: LimitedQueries) -> None:
        self._context, self._queries = context, queries

    @property
    def _map(self) -> SemanticMap:
        return self._context.semantic_map

    def describe_map(self) -> a.MapDescription:
        """Describe this map: title, categories with counts, places with beliefs, robot pose.

        Ask this first.
        """
        identity, description = self._context.identity(), self._map.description
        counted = self._map.query("summary").records()
        places, robot = self._map.places(), self._map.robot()
        max_listed = self._context.max_listed
        return a.MapDescription(
            map=identity,
            created=time_or_none(_moment(description.created)),
            licence=description.licence,
            objects=sum(int(str(row["count"])) for row in counted),
            categories=[
                a.CategoryCount(
                    untrusted_category=str(row["category"]),
                    count=int(str(row["count"])),
                    last_seen=time_or_none(row["lastSeen"]),
                )
                for row in counted[:max_listed]
            ],
            categories_left_out=max(len(counted) - max_listed, 0),
            places=[self._summary(place) for place in places[:max_listed]],
            places_left_out=max(len(places) - max_listed, 0),
            robot=None
            if robot is None
            else a.Pose(
                x=round(float(robot.p_map[0]), 3),
                y=round(float(robot.p_map[1]), 3),
                heading=round(robot.heading, 4),
                time=iso(robot.stamp),
            ),
            writable=self._context.writable,
        )

    def where_is(self, what: Word, limit: Limit = 10) -> a.WhereIs:
        """Find things: a category (cup), a synonym, a need ("something to sit on"), or one
        thing (object/17). Surest first, with place, position, probability and when last seen.

        If the map has none, `status` tells whether it is gone, hidden, or was never looked for;
        `departed` lists such things that left their spot.
        """
        identity = self._context.identity()
        if self._context.is_thing(what):
            return a.WhereIs(map=identity, things=[self._one(self._context.iri(what))])
        (target,) = resolve(self._map, (what,))
        known = known_objects(self._map, target, located=limit)
        listed, left_out = known_things(known, limit)
        found = None if known or target.iri is None else status(self._map, target.iri)
        return a.WhereIs(
            map=identity,
            things=listed,
            left_out=left_out,
            departed=self._departed(target.queried)[:limit],
            status=None if found is None else found.value,
            untrusted_proof=None if found is None else found.proof,
        )

    def what_is_at(
        self, x: Metres, y: Metres, radius: Radius = 0.5, least: Least = 0.5, limit: Limit = 20
    ) -> a.AtPoint:
        """The place that a point of the floor is in, and objects within `radius` of the point."""
        identity = self._context.identity()
        place = next((p for p in self._map.places() if p.area.contains(x, y)), None)
        rows = self._within(x, y, radius, least)
        return a.AtPoint(
            map=identity,
            things=[thing(row) for row in rows[:limit]],
            left_out=max(len(rows) - limit, 0),
            place=None if place is None else place.iri,
            untrusted_place=None if place is None else place.label,
        )

    def what_is_near(
        self, what: ThingName, radius: Radius = 2.0, least: Least = 0.5, limit: Limit = 20
    ) -> a.Things:
        """Objects around one thing (object/17), nearest first; `what_is_at` takes a point."""
        identity, iri = self._context.identity(), self._context.iri(what)
        x, y = self._position(iri)
        rows = [row for row in self._within(x, y, radius, least) if row["object"] != iri]
        return _things(identity, rows, limit)

    def what_is_between(
        self,
        one: ThingName,
        other: ThingName,
        width: Annotated[float, Field(gt=0, le=1000, description="metres of floor")] = 1.0,
        least: Least = 0.5,
        limit: Limit = 20,
    ) -> a.Things:
        """Objects on the strip of floor from one thing (object/17) to another, in this order."""
        identity, ends = self._context.identity(), [self._context.iri(o) for o in (one, other)]
        for iri in ends:
            self._position(iri)  # raises for anything else than an object
        strip = {"one": ends[0], "other": ends[1], "width": width, "least": least}
        return _things(identity, list(self._map.query("between", **strip).records()), limit)

    def what_is_in(
        self,
        what: Annotated[
            str, Field(min_length=1, max_length=300, description="place, or object/17")
        ],
        least: Least = 0.5,
        limit: Limit = 20,
    ) -> a.Things:
        """Objects in a place (kitchen, its label, place/1), or on and in a thing (object/17)."""
        identity = self._context.identity()
        if not self._context.is_thing(what):
            place = self._context.place(what)
            rows = self._map.query("objects-in-place", place=place, least=least).records()
            return _things(identity, rows, limit)
        iri = self._context.iri(what)
        self._position(iri)  # raises for anything else than an object
        related = self._map.query("related", object=iri).records()
        rows = [
            row
            for row in related
            if row["relation"] in ("on", "inside")
            and (number_or_none(row, "existence") or 0) >= least
        ]
        return _things(identity, rows, limit)

    def status(
        self,
        what: Annotated[
            str, Field(min_length=1, max_length=300, description="category, or object/17")
        ],
        place: Annotated[
            str | None,
            Field(max_length=300, description="only there: label, kind (kitchen), place/1"),
        ] = None,
        limit: Limit = 20,
    ) -> a.StatusAnswer:
        """Whether something is present, gone (its place was viewed and it is not there), hidden
        (part of its place was never in view) or never looked for; when, and the proof.
        """
        identity = self._context.identity()
        where = None if place is None else self._context.place(place)
        found = status(self._map, what, where)
        return a.StatusAnswer(
            map=identity,
            status=found.value,
            untrusted_target=found.target,
            untrusted_proof=found.proof,
            places=[_place_status(one) for one in found.places[:limit]],
            left_out=max(len(found.places) - limit, 0),
        )

    def why(
        self,
        what: Annotated[
            str,
            Field(
                min_length=1,
                max_length=600,
                description="object/17, place/1, or a fact: object/17 here:inPlace place/1",
            ),
        ],
        limit: Limit = 40,
    ) -> a.WhyAnswer:
        """Why the map holds a thing or a fact: the frame, box, pose, rule, model or person behind
        it, and the transaction that wrote it.
        """
        identity = self._context.identity()
        steps = [step for reason in self._map.history.explain(what) for step in reason.walk()]
        return a.WhyAnswer(
            map=identity,
            steps=[
                a.Step(depth=depth, kind=step.kind, untrusted_text=step.text, iri=step.iri)
                for depth, step in steps[:limit]
            ],
            left_out=max(len(steps) - limit, 0),
        )

    def ask_sparql(
        self,
        query: Annotated[str, Field(min_length=1, max_length=20_000)],
        limit: Annotated[int, Field(ge=1, le=500, description="maximum number of rows")] = 50,
    ) -> a.Rows:
        """Any reading SPARQL 1.1 query (SELECT, ASK, CONSTRUCT, DESCRIBE), for questions that no
        other tool answers. Prefixes here:, graph:, rdfs: are declared; 10 s, 4 MB.

        Example: SELECT ?cup ?z WHERE { ?cup a here:Cup ; here:z ?z } ORDER BY ?z LIMIT 10
        """
        identity, table = self._context.identity(), self._queries.ask(query)
        return a.Rows(
            map=identity,
            untrusted_columns=list(table.columns),
            untrusted_rows=[[_plain(cell) for cell in row] for row in table.rows[:limit]],
            left_out=max(len(table.rows) - limit, 0),
        )

    def _departed(self, categories: Sequence[str]) -> list[a.Departed]:
        rows = [
            row
            for category in categories
            for row in self._map.query("last-seen", category=category).records()
            if row["foundGone"] is not None
        ]
        return [_departed(row) for row in {str(row["object"]): row for row in rows}.values()]

    def _one(self, iri: str) -> a.KnownThing:
        x, y = self._position(iri)
        for row in self._within(x, y, _SAME_SPOT, 0.0):
            if row["object"] == iri:
                where = whereabouts(self._map, iri)
                return a.KnownThing(
                    **thing(row).model_dump(exclude={"distance"}), untrusted_where=where
                )
        raise self._unknown(iri)

    def _position(self, iri: str) -> tuple[float, float]:
        rows = self._map.query("whereabouts", object=iri).records()
        if not rows:
            raise self._unknown(iri)
        return float(str(rows[0]["x"])), float(str(rows[0]["y"]))

    def _unknown(self, iri: str) -> QueryParameterError:
        return QueryParameterError(
            f"{iri} is no object of the map now; history and status tell its fate, where_is finds "
            "objects by category"
        )

    def _within(self, x: float, y: float, radius: float, least: float) -> list[Row]:
        found = self._map.query("objects-within-radius", x=x, y=y, radius=radius, least=least)
        return list(found.records())

    def _summary(self, place: PlaceRecord) -> a.PlaceSummary:
        top = max(place.beliefs, key=lambda iri: (place.beliefs[iri], iri), default=None)
        viewed = place.viewed
        return a.PlaceSummary(
            iri=place.iri,
            untrusted_label=place.label,
            untrusted_category=None if top is None else self._map.catalogue.label(top),
            probability=None if top is None else round(place.beliefs[top], 4),
            viewed_share=None if viewed is None else viewed.share,
            last_viewed=None if viewed is None else iso(viewed.last),
            xmin=place.xmin,
            xmax=place.xmax,
            ymin=place.ymin,
            ymax=place.ymax,
        )


def known_things(known: Sequence[KnownObject], limit: int) -> tuple[list[a.KnownThing], int]:
    """The first `limit` objects as answers, and the number of the others."""
    return [_known(one) for one in known[:limit]], max(len(known) - limit, 0)


def _known(one: KnownObject) -> a.KnownThing:
    return a.KnownThing(
        iri=one.iri,
        untrusted_label=one.label,
        untrusted_category=one.own or one.category,
        probability=round(one.existence, 6),
        x=round(float(one.p_map[0]), 3),
        y=round(float(one.p_map[1]), 3),
        last_seen=time_or_none(one.last_seen),
        observations=one.observations,
        untrusted_where=one.where,
        may_be=[a.Alternative(untrusted_category=c, probability=p) for c, p in one.may_be],
        untrusted_frame=one.frame,
        found_by=one.found_by,
    )


def _things(identity: a.MapIdentity, rows: Sequence[Row], limit: int) -> a.Things:
    listed = [thing(row) for row in rows[:limit]]
    return a.Things(map=identity, things=listed, left_out=max(len(rows) - limit, 0))


def thing(row: Row) -> a.Thing:
    """A row of a shipped query about objects; columns that it lacks stay empty."""
    existence, seen = number_or_none(row, "existence"), row.get("lastSeen")
    place, count = row.get("place"), number_or_none(row, "observations")
    relation = row.get("relation")
    return a.Thing(
        iri=str(row["object"]),
        untrusted_label=str(row["label"] or row["category"]),
        untrusted_category=str(row["category"]),
        # asserted objects have no existence probability
        probability=1.0 if existence is None else round(existence, 6),
        **{name: number_or_none(row, name) for name in ("x", "y", "z", "distance")},
        untrusted_place=None if place is None else str(place),
        last_seen=time_or_none(seen),
        observations=None if count is None else int(count),
        relation=None if relation is None else str(relation),
    )


def _departed(row: Row) -> a.Departed:
    seen, place = row["lastSeen"], row["place"]
    return a.Departed(
        iri=str(row["object"]),
        untrusted_label=str(row["label"] or row["category"]),
        untrusted_place=None if place is None else str(place),
        x=float(str(row["x"])),
        y=float(str(row["y"])),
        last_seen=time_or_none(seen),
        found_gone=time_or_none(row["foundGone"]),
    )


def _place_status(one: PlaceStatus) -> a.PlaceStatus:
    return a.PlaceStatus(
        place=one.place,
        untrusted_place=one.place_label,
        status=one.value,
        thing=one.object,
        probability=one.existence,
        last_seen=time_or_none(one.last_seen),
        viewed_share=one.viewed_share,
        closely_viewed_share=one.closely_viewed_share,
        last_viewed=time_or_none(one.last_viewed),
    )


def _moment(text: str) -> datetime | None:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def _plain(cell: object) -> str | float | int | bool | None:
    if cell is None or isinstance(cell, bool | int):
        return cell
    if isinstance(cell, float):
        return cell if math.isfinite(cell) else str(cell)
    return time_or_none(cell) if isinstance(cell, datetime) else str(cell)
