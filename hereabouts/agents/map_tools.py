"""Tools that read a map: objects, places, status, explanations, answers to plain questions."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Final

from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.list_tools import At, Limit, Skip, Word, thing, unknown, unnamed_things
from hereabouts.agents.map_context import MapContext, state_of
from hereabouts.agents.plain_values import clock, for_agents, time_or_none
from kg.maps.semantic_map import SemanticMap
from kg.model.place_names import plain_place
from kg.model.records import PlaceRecord, likeliest
from kg.serving.workers.local_evaluation import LimitedQueries
from planner.freespace.planning_map import Row
from planner.questions.answers import answer_question
from planner.questions.patterns import MAX_LENGTH, Question
from planner.questions.rooms import about_rooms
from planner.search.goals.known_objects import KnownObject, known_object, known_objects, map_time
from planner.search.goals.place_names import (
    fact_named,
    is_unnamed,
    notes_of,
    object_named,
    spoken_places,
    stated_categories,
)
from planner.search.goals.search_goals import whereabouts
from planner.search.goals.status import status
from planner.search.goals.targets import resolve, undetectable_target

_COUNTS: Final = 40  # categories of a description
_DEPARTED: Final = 3


class MapTools:
    """The reading tools of one map. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext, queries: LimitedQueries) -> None:
        self._context, self._queries = context, queries

    @property
    def _map(self) -> SemanticMap:
        return self._context.semantic_map

    def describe_map(self, skip: Skip = 0) -> a.MapDescription:
        """Ask this first: title, counts of categories, places, robot pose.

        `base` + id is the IRI of a thing.
        """
        state, description = self._context.state(), self._map.description
        counted = self._map.query("summary").records()
        places, robot = self._map.places(), self._map.robot()
        return a.MapDescription(
            map=state,
            untrusted_title=description.title,
            base=self._map.base,
            created=time_or_none(_moment(description.created)),
            licence=description.licence,
            objects=sum(int(str(row["count"])) for row in counted),
            categories=len(counted),
            untrusted_counts=[
                (str(row["category"]), int(str(row["count"]))) for row in counted[:_COUNTS]
            ],
            without_name=len(self._map.unnamed_things()) or None,
            places=[self._summary(place) for place in places[skip:][:100]],
            total=len(places),
            skip=skip,
            robot=None
            if robot is None
            else a.Pose(
                x=float(robot.p_map[0]),
                y=float(robot.p_map[1]),
                heading=robot.heading,
                time=clock(robot.stamp),
            ),
            writable=self._context.writable,
        )

    def where_is(self, what: Word, at: At = None, limit: Limit = 10, skip: Skip = 0) -> a.WhereIs:
        """Find things: a category (cup), a synonym, a need ("something to sit on"), or one
        thing (object/17). Surest first.

        Without a sure one, `status` tells if it is gone, hidden, not seen, or was never looked
        for: then its place is not known. `departed` left their spot. Of a thing that no detector
        can see (keys), the proof says where it usually is; of a room (kitchen), where it is.
        """
        with self._context.at(at) as semantic_map:
            state = state_of(semantic_map)
            now = time.time() if at is None else map_time(semantic_map)
            if iri := object_named(semantic_map, what):
                one = one_thing(semantic_map, iri, now)
                return a.WhereIs(map=state, things=[one], total=1)
            if is_unnamed(what):
                unnamed = unnamed_things(semantic_map)
                return a.WhereIs(
                    map=state,
                    things=[
                        a.LocatedThing(**thing(r).model_dump()) for r in unnamed[skip:][:limit]
                    ],
                    total=len(unnamed),
                    skip=skip,
                )
            if rooms := about_rooms(semantic_map, Question("where", what), time.time()):
                proof = ". ".join(rooms) + "."
                return a.WhereIs(map=state, things=[], total=0, untrusted_proof=proof)
            if (unseen := undetectable_target(semantic_map, what)) is not None:
                proof = unseen.answer + "."
                return a.WhereIs(map=state, things=[], total=0, untrusted_proof=proof)
            (target,) = resolve(semantic_map, (what,))
            known = known_objects(semantic_map, target)
            unsure = target.iri is not None and not any(one.sure for one in known)
            found = status(semantic_map, target.iri) if unsure and target.iri else None
            return a.WhereIs(
                map=state,
                things=[known_thing(one, now) for one in known[skip : skip + limit]],
                total=len(known),
                skip=skip,
                departed=_departed_of(semantic_map, target.queried)[:_DEPARTED] or None,
                status=None if found is None else found.value,
                untrusted_proof=None if found is None else found.proof,
                untrusted_understood=target.note or None,
            )

    def status(
        self,
        what: Annotated[
            str, Field(min_length=1, max_length=300, description="category, or object/17")
        ],
        place: Annotated[str | None, Field(max_length=300, description="only there")] = None,
        at: At = None,
        skip: Skip = 0,
    ) -> a.StatusAnswer:
        """Whether something is present, gone (it was there, and its spot is empty), looked for
        without any seen, hidden (one may stand where nobody viewed) or never looked for; proof.
        """
        with self._context.at(at) as semantic_map:
            where = None if place is None else semantic_map.resolve("place", place)
            found = status(semantic_map, what, where)
            return a.StatusAnswer(
                map=state_of(semantic_map),
                status=found.value,
                untrusted_target=found.target,
                untrusted_proof=found.proof,
                places=[a.StatusInPlace.model_validate(one) for one in found.places[skip:][:20]],
                total=len(found.places),
                skip=skip,
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
        skip: Skip = 0,
    ) -> a.WhyAnswer:
        """Why the map holds a thing or a fact: frame, box, rule, model or person behind it."""
        state, base = self._context.state(), self._map.base
        fact = fact_named(self._map, what)
        steps = [step for reason in self._map.history.explain(fact) for step in reason.walk()]
        return a.WhyAnswer(
            map=state,
            steps=[
                a.Step(
                    depth=depth,
                    kind=step.kind,
                    untrusted_text=step.text,
                    id=None if (step.iri or "").removeprefix(base) in step.text else step.iri,
                )
                for depth, step in steps[skip:][:40]
            ],
            total=len(steps),
            skip=skip,
        )

    def ask_sparql(
        self,
        query: Annotated[str, Field(min_length=1, max_length=20_000)],
        limit: Annotated[int, Field(ge=1, le=500)] = 50,
        skip: Skip = 0,
    ) -> a.Rows:
        """A reading SPARQL 1.1 query, for what no other tool answers. Prefixes here:, graph:,
        rdfs: are declared; <object/17> is the map's.

        Example: SELECT ?cup ?z WHERE { ?cup a here:Cup ; here:z ?z } ORDER BY ?z LIMIT 10
        """
        state, table = self._context.state(), self._queries.ask(query)
        return a.Rows(
            map=state,
            untrusted_columns=list(table.columns),
            untrusted_rows=[
                [_plain(cell, self._map.base) for cell in row]
                for row in table.rows[skip : skip + limit]
            ],
            total=len(table.rows),
            skip=skip,
            notes=[*table.notes[:8]],
        )

    def _summary(self, place: PlaceRecord) -> a.PlaceSummary:
        top = likeliest(place.beliefs)
        viewed = place.viewed
        return a.PlaceSummary(
            id=place.iri,
            untrusted_label=place.label,
            untrusted_category=None if top is None else plain_place(self._map.catalogue.label(top)),
            probability=None if top is None else place.beliefs[top],
            viewed_share=None if viewed is None else viewed.share,
            last_viewed=None if viewed is None else clock(viewed.last),
            x=[place.xmin, place.xmax],
            y=[place.ymin, place.ymax],
            **{
                f"untrusted_{name}": given
                for note in notes_of(self._map, place.iri)
                for name, given in zip(("note", "note_by"), note, strict=True)
            },
        )


def _departed_of(semantic_map: SemanticMap, categories: Sequence[str]) -> list[a.Departed]:
    rows = [
        row
        for category in categories
        for row in semantic_map.query("last-seen", category=category).records()
        if row["foundGone"] is not None
    ]
    return [_departed(row) for row in {str(row["object"]): row for row in rows}.values()]


def one_thing(semantic_map: SemanticMap, iri: str, now: float) -> a.LocatedThing:
    """One object as an answer at `now` [s since 1970]; raises QueryParameterError for none."""
    rows = semantic_map.query("objects", least=0.0).records()
    stated = stated_categories(semantic_map).get(iri)
    for row in rows:
        if row["object"] == iri:
            return a.LocatedThing(
                untrusted_category_by=stated.by if stated else None,
                untrusted_detected_as=(stated.detected_as or None) if stated else None,
                **thing(row).model_dump(),
                untrusted_where=whereabouts(semantic_map, iri, spoken_places(semantic_map)),
                still_there=_still_there(semantic_map, iri, str(row["category"]), now),
            )
    raise unknown(iri)


def _still_there(semantic_map: SemanticMap, iri: str, category: str, now: float) -> float | None:
    known = semantic_map.catalogue.get(category, "object")
    if known is None or known.undetected:
        return None
    _, one = known_object(semantic_map, iri, category)
    return None if one is None else one.still_there(now)


def known_thing(one: KnownObject, now: float) -> a.LocatedThing:
    """An object that matches a query as an answer, at `now` [s since 1970]."""
    return a.LocatedThing(
        id=one.iri,
        untrusted_label=one.label,
        untrusted_category=one.own or one.category,
        probability=one.existence,
        still_there=one.still_there(now),
        x=float(one.p_map[0]),
        y=float(one.p_map[1]),
        z=one.z,
        last_seen=time_or_none(one.last_seen),
        observations=one.observations,
        untrusted_where=one.where,
        untrusted_may_be=list(one.may_be[:3]) or None,
        untrusted_frame=one.frame,
        untrusted_category_by=one.stated.by if one.stated else None,
        untrusted_detected_as=(one.stated.detected_as or None) if one.stated else None,
        found_by=one.found_by,
    )


def _departed(row: Row) -> a.Departed:
    seen, place = row["lastSeen"], row["place"]
    return a.Departed(
        id=str(row["object"]),
        untrusted_label=str(row["label"] or row["category"]),
        untrusted_place=None if place is None else str(place),
        x=float(str(row["x"])),
        y=float(str(row["y"])),
        last_seen=time_or_none(seen),
        found_gone=time_or_none(row["foundGone"]),
    )


def _moment(text: str) -> datetime | None:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def _plain(cell: object, base: str) -> str | float | int | bool | None:
    if cell is None or isinstance(cell, bool | int):
        return cell
    if isinstance(cell, float):
        return cell if math.isfinite(cell) else str(cell)
    if isinstance(cell, str):
        return cell.removeprefix(base) or cell
    return time_or_none(cell) if isinstance(cell, datetime) else str(cell)


class QuestionTools:
    """The tool on questions in English; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context

    def ask(
        self, question: Annotated[str, Field(min_length=1, max_length=MAX_LENGTH)]
    ) -> a.QuestionAnswer:
        """A question in sentences: "where is the cup?", "how many chairs are in the kitchen?" """
        state = self._context.state()
        found = answer_question(self._context.semantic_map, question)
        return a.QuestionAnswer(
            map=state, kind=found.kind, untrusted_answer=for_agents(found.lines)
        )
