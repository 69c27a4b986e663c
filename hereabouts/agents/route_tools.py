"""Tools that show a thing and the way to it: pictures and routes."""

from __future__ import annotations

import math
from itertools import islice
from typing import Annotated, Final

import numpy as np
from mcp.server.mcpserver import Image
from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.list_tools import Metres, Skip, ThingName
from hereabouts.agents.map_context import MapContext
from hereabouts.agents.plain_values import clock
from hereabouts.agents.search_tools import start_of
from hereabouts.display.naming_sheet import things_to_name
from kg.maps.object_pictures import MAX_VIEW_BYTES, view_picture
from kg.model.errors import QueryParameterError
from kg.model.regular_files import read_bytes
from mapping.looks.word_looks import alike, compares_texts
from planner.search.plans.route import route
from planner.settings import SPEED

_PICTURES: Final = 12  # of things to name, in one answer
_PIXELS: Final = 1000  # along the longer side of the map's picture ...
_DRAWN: Final = 1000  # ... and objects in it, which takes seconds


class RouteTools:
    """Pictures and routes of one map. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context, self._drawn = context, (-1, b"")

    def picture(
        self,
        what: ThingName | None = None,
        like: Annotated[
            str | None, Field(max_length=100, description="the corner with the plants")
        ] = None,
        skip: Skip = 0,
    ) -> tuple[a.ToolAnswer, *tuple[Image, ...]]:
        """A small picture of a thing (object/17), of the "map" with names, or of the view that
        looks most `like` a text, with its pose; without both, of twelve things to name.
        """
        if like is not None:
            return self._alike(like)
        if what is None:
            return self._to_name(skip)
        if what == "map":
            return self._plan()
        state, semantic_map = self._context.state(), self._context.semantic_map
        found = semantic_map.perceived.objects([semantic_map.resolve("iri", what)])
        jpeg = semantic_map.picture(found[0].iri) if found else None
        if jpeg is None or found[0].evidence is None:
            raise QueryParameterError(
                f"the map has no picture of {what}; where_is finds objects, and why tells the frame"
            )
        shown = found[0].evidence
        about = a.PictureOf(
            map=state,
            thing=found[0].iri,
            untrusted_category=semantic_map.catalogue.label(found[0].category),
            untrusted_recording=shown.recording,
            untrusted_frame=shown.frame,
            box=[round(value) for value in shown.box],
            time=clock(shown.stamp),
        )
        return about, Image(data=jpeg, format="jpeg")

    def _plan(self) -> tuple[a.ToolAnswer, Image]:
        """The map as people see it, drawn once for each state of it."""
        from hereabouts.display.plots.map_plot import map_png

        state, semantic_map = self._context.state(), self._context.semantic_map
        if self._drawn[0] != state.sequence:
            if (many := len(semantic_map.objects())) > _DRAWN:
                raise QueryParameterError(
                    f"a picture shows at most {_DRAWN:,} objects, and the map has {many:,}; "
                    "list_things tells them by place"
                )
            self._drawn = state.sequence, map_png(semantic_map, _PIXELS)
        return a.ToolAnswer(map=state), Image(data=self._drawn[1], format="png")

    def _alike(self, text: str) -> tuple[a.AlikeViewOf, Image]:
        state, semantic_map = self._context.state(), self._context.semantic_map
        found = alike(semantic_map, text) if compares_texts(semantic_map) else None
        if found is None or semantic_map.store.path is None:
            raise QueryParameterError("the map has no encoder to compare views with a text")
        if not found.views:
            raise QueryParameterError(
                f"no view looks like {text!r}, says the encoder {found.encoder}"
            )
        view = found.views[0]
        jpeg = read_bytes(view_picture(semantic_map.store.path, *view.key), MAX_VIEW_BYTES)
        about = a.AlikeViewOf(
            map=state,
            x=view.x,
            y=view.y,
            heading=view.heading,
            untrusted_recording=view.recording,
            untrusted_frame=view.frame,
            encoder=found.encoder,
        )
        return about, Image(data=jpeg, format="jpeg")

    def _to_name(self, skip: int) -> tuple[a.ThingsToName, *tuple[Image, ...]]:
        """Things with pictures, in the order of their images; those without a name first."""
        state, semantic_map = self._context.state(), self._context.semantic_map
        things = list(islice(things_to_name(semantic_map), skip, skip + _PICTURES))
        listed = a.ThingsToName(
            map=state,
            things=[semantic_map.base + one.short for one in things],
            untrusted_categories=[one.category for one in things],
        )
        return listed, *(Image(data=one.picture, format="jpeg") for one in things)

    def route(
        self,
        to: Annotated[
            str | None, Field(max_length=300, description="object/17, place/1 or kitchen")
        ] = None,
        to_x: Metres | None = None,
        to_y: Metres | None = None,
        x: Metres | None = None,
        y: Metres | None = None,
        skip: Skip = 0,
    ) -> a.RouteAnswer:
        """Whether and how far one can drive `to` a thing, place or point, and through which doors.

        From x, y, or from where the robot is.
        """
        state, semantic_map = self._context.state(), self._context.semantic_map
        start, goal = start_of(semantic_map, x, y), self._goal(to, to_x, to_y)
        found = route(semantic_map, start[:2], goal)
        if found is None:
            raise QueryParameterError("the map has no floor and no places, so no way is known")
        if not math.isfinite(found.metres):
            return a.RouteAnswer(
                map=state, total=0, reachable=False, notes=list(found.notes) or None
            )
        return a.RouteAnswer(
            map=state,
            reachable=True,
            metres=found.metres,
            seconds=found.metres / SPEED,
            end=found.end.tolist(),
            end_to_goal=float(np.linalg.norm(found.end - goal)),
            unseen_metres=found.unseen,
            notes=list(found.notes) or None,
            doors=[
                a.RouteDoor(
                    id=None if one.door is None else one.door.iri,
                    between=[place.iri for place in one.places],
                    untrusted_into=one.places[1].label,
                    x=one.x,
                    y=one.y,
                    width=None if one.door is None else one.door.width,
                )
                for one in found.crossings[skip:][:50]
            ],
            total=len(found.crossings),
            skip=skip,
        )

    def _goal(self, to: str | None, x: float | None, y: float | None) -> tuple[float, float]:
        if (to is None) == (x is None or y is None):
            raise QueryParameterError("give either `to`, or `to_x` and `to_y`")
        if to is None:
            return float(x or 0.0), float(y or 0.0)
        semantic_map = self._context.semantic_map
        iri = semantic_map.resolve("iri", to)
        if iri.startswith(f"{semantic_map.base}object/"):
            rows = semantic_map.query("whereabouts", object=iri).records()
            if not rows:
                raise QueryParameterError(f"{to} is no object of the map now; where_is finds some")
            return float(str(rows[0]["x"])), float(str(rows[0]["y"]))
        iri = semantic_map.resolve("place", iri)
        return next(p.area.centre for p in semantic_map.places() if p.iri == iri)
