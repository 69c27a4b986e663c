"""Tools that list the things of a map: of a place, around a thing or point, between two, recent."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Annotated

from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.map_context import MapContext, number_or_none, state_of
from hereabouts.agents.plain_values import time_or_none
from kg.maps.map_extent import check_positions
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from planner.freespace.planning_map import Row
from planner.search.goals.place_names import is_unnamed
from planner.search.goals.targets import resolve

Word = Annotated[str, Field(min_length=1, max_length=100)]
ThingName = Annotated[str, Field(min_length=1, max_length=300, description="object/17")]
Limit = Annotated[int, Field(ge=1, le=100)]
Skip = Annotated[int, Field(ge=0, le=1_000_000, description="`more` of the page before")]
Metres = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]
Least = Annotated[float, Field(ge=0, le=1, description="minimum existence")]
At = Annotated[
    str | None,
    Field(max_length=40, description="past moment of writing: #42, ISO 8601, or 2h (ago)"),
]
Radius = Annotated[float, Field(gt=0, le=1000)]


class ListTools:
    """The listing tools of one map. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context

    def list_things(
        self,
        inside: Annotated[
            str | None, Field(max_length=300, description="kitchen, place/1, or object/17")
        ] = None,
        near: Annotated[str | None, Field(max_length=300, description="object/17")] = None,
        x: Metres | None = None,
        y: Metres | None = None,
        to: Annotated[
            str | None, Field(max_length=300, description="object/18: those between near and it")
        ] = None,
        radius: Annotated[Radius, Field(description="of near; width of between [m]")] = 1.0,
        what: Annotated[Word | None, Field(description="only this category")] = None,
        at: At = None,
        least: Least = 0.5,
        limit: Limit = 20,
        skip: Skip = 0,
    ) -> a.Things:
        """Objects in a place, on or in a thing (`inside`); around a thing or the point x, y,
        nearest first; between two things; or all of them. `total` counts them.
        """
        with self._context.at(at) as semantic_map:
            rows, place = self._rows(semantic_map, inside, near, (x, y), to, radius, least), None
            if what is not None and is_unnamed(what):
                rows = self._unnamed(semantic_map, inside, near, (x, y), radius)
            elif what is not None:
                (target,) = resolve(semantic_map, (what,))
                kinds = {
                    str(row["object"])
                    for category in target.queried
                    for row in semantic_map.query(
                        "objects-by-category", category=category, least=least
                    ).records()
                }
                rows = [row for row in rows if str(row["object"]) in kinds]
            if x is not None and y is not None:
                place = next((p for p in semantic_map.places() if p.area.contains(x, y)), None)
            return a.Things(
                map=state_of(semantic_map),
                things=[thing(row) for row in rows[skip : skip + limit]],
                total=len(rows),
                skip=skip,
                place=None if place is None else place.iri,
                untrusted_place=None if place is None else place.label,
            )

    def _rows(
        self,
        semantic_map: SemanticMap,
        inside: str | None,
        near: str | None,
        point: tuple[float | None, float | None],
        to: str | None,
        radius: float,
        least: float,
    ) -> list[Row]:
        x, y = point
        if (x is None) != (y is None):
            raise QueryParameterError("give both x and y, or neither")
        if (inside is not None) + (near is not None) + (x is not None) > 1:
            raise QueryParameterError("give one of `inside`, `near`, and x with y")
        if x is not None and y is not None:
            check_positions(semantic_map.engine, [(x, y)], "point", QueryParameterError)
        if to is not None and near is None:
            raise QueryParameterError("`to` needs `near`: the two things to look between")
        if inside is not None:
            return self._inside(semantic_map, inside, least)
        if near is not None and to is not None:
            ends = [semantic_map.resolve("iri", one) for one in (near, to)]
            for iri in ends:
                _position(semantic_map, iri)  # raises for anything else than an object
            found = semantic_map.query(
                "between", one=ends[0], other=ends[1], width=radius, least=least
            )
            return list(found.records())
        if near is not None:
            iri = semantic_map.resolve("iri", near)
            x, y = _position(semantic_map, iri)
            around = _within(semantic_map, x, y, radius, least)
            return [row for row in around if row["object"] != iri]
        if x is not None and y is not None:
            return _within(semantic_map, x, y, radius, least)
        return list(semantic_map.query("objects", least=least).records())

    def _inside(self, semantic_map: SemanticMap, inside: str, least: float) -> list[Row]:
        iri = semantic_map.resolve("iri", inside)
        if not iri.startswith(f"{semantic_map.base}object/"):
            place = semantic_map.resolve("place", iri)
            rows = semantic_map.query("objects-in-place", place=place, least=least)
            return list(rows.records())
        _position(semantic_map, iri)  # raises for anything else than an object
        return [
            row
            for row in semantic_map.query("related", object=iri).records()
            if row["relation"] in ("on", "inside")
            and (number_or_none(row, "existence") or 0) >= least
        ]

    def _unnamed(
        self,
        semantic_map: SemanticMap,
        inside: str | None,
        near: str | None,
        point: tuple[float | None, float | None],
        radius: float,
    ) -> list[Row]:
        """The things without a name in a place, or around a thing or point, as rows."""
        place = None if inside is None else semantic_map.resolve("iri", inside)
        x, y = point
        if near is not None:
            x, y = _position(semantic_map, semantic_map.resolve("iri", near))
        return [
            row
            for row, one in zip(
                unnamed_things(semantic_map), semantic_map.unnamed_things(), strict=True
            )
            if place in (None, one.place)
            and (x is None or y is None or math.dist(one.p_map[:2], (x, y)) <= radius)
        ]

    def recent(
        self,
        inside: Annotated[str | None, Field(max_length=300, description="kitchen, place/1")] = None,
        limit: Limit = 10,
        skip: Skip = 0,
    ) -> a.Things:
        """Objects by their last sighting, the latest first; compare with `time` of the map."""
        rows = self._rows(self._context.semantic_map, inside, None, (None, None), None, 1.0, 0.5)
        rows = sorted(
            (row for row in rows if isinstance(row["lastSeen"], datetime)),
            key=lambda row: (str(time_or_none(row["lastSeen"])), str(row["object"])),
            reverse=True,
        )
        return a.Things(
            map=self._context.state(),
            things=[thing(row) for row in rows[skip : skip + limit]],
            total=len(rows),
            skip=skip,
        )


def _position(semantic_map: SemanticMap, iri: str) -> tuple[float, float]:
    rows = semantic_map.query("whereabouts", object=iri).records()
    if not rows:
        raise unknown(iri)
    return float(str(rows[0]["x"])), float(str(rows[0]["y"]))


def unnamed_things(semantic_map: SemanticMap) -> list[Row]:
    """The things without a name as rows, with the columns of the query `objects`."""
    labels = {one.iri: one.label for one in semantic_map.places()}
    return [
        {
            "object": one.iri,
            "label": semantic_map.catalogue.title(one.category, one.iri),
            "category": "unnamed thing",
            "existence": one.existence,
            **dict(zip("xyz", one.p_map.tolist(), strict=True)),
            "place": labels.get(one.place or ""),
            "observations": one.observations,
            "lastSeen": datetime.fromtimestamp(one.last_seen, UTC),
        }
        for one in semantic_map.unnamed_things()
    ]


def unknown(iri: str) -> QueryParameterError:
    """The error for an object that the map does not have now."""
    return QueryParameterError(
        f"{iri} is no object of the map now; history and status tell its fate, where_is finds "
        "objects by category"
    )


def _within(
    semantic_map: SemanticMap, x: float, y: float, radius: float, least: float
) -> list[Row]:
    found = semantic_map.query("objects-within-radius", x=x, y=y, radius=radius, least=least)
    return list(found.records())


def thing(row: Row) -> a.Thing:
    """A row of a shipped query about objects; columns that it lacks stay empty."""
    existence, seen = number_or_none(row, "existence"), row.get("lastSeen")
    place, count = row.get("place"), number_or_none(row, "observations")
    relation = row.get("relation")
    return a.Thing(
        id=str(row["object"]),
        untrusted_label=str(row["label"] or row["category"]),
        untrusted_category=str(row["category"]),
        # asserted objects have no existence probability
        probability=1.0 if existence is None else existence,
        **{name: number_or_none(row, name) for name in ("x", "y", "z", "distance")},
        untrusted_place=None if place is None else str(place),
        last_seen=time_or_none(seen),
        observations=None if count is None else int(count),
        relation=None if relation is None else str(relation),
    )
