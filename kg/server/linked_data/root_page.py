"""`/`: the map itself, as a page for people or as its description for programs."""

from __future__ import annotations

import threading
import time
from functools import partial

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.query.evaluation import Value
from kg.query.query_files import query_summaries
from kg.records import PlaceRecord
from kg.server.app_state import AppState
from kg.server.http.bodies import query_parameters
from kg.server.http.media_types import GRAPH_FORMATS, HTML, accept_of
from kg.server.linked_data.description import dataset_description, graph_sizes
from kg.server.linked_data.pages import front_page
from kg.server.linked_data.resource_description import local_path
from kg.server.linked_data.svg_plan import Spot, floor_plan
from kg.vocabulary import MAP_GRAPH
from kg.workers.content_negotiation import negotiate

FRESH = 1.0  # [s] for which a page is handed out again although the map moved on


class RootPage:
    """Makes the front page, at most once for a state of the map and once a second."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._page = ""
        self._sequence = -1
        self._made = 0.0

    async def answer(self, serving: AppState, request: Request) -> Response:
        """The page, or VoID and DCAT where the client accepts RDF."""
        media_type = negotiate(
            accept_of(request, query_parameters(request)), (*GRAPH_FORMATS, HTML)
        )
        if media_type != HTML:
            return await dataset_description(serving, request)
        page = await run_in_threadpool(partial(self.page, serving))
        return Response(page, media_type=HTML, headers={"Vary": "Accept"})

    def page(self, serving: AppState) -> str:
        """The page as HTML."""
        with self._guard:
            sequence, now = serving.semantic_map.sequence, time.monotonic()
            if not self._page or (sequence != self._sequence and now - self._made > FRESH):
                self._page, self._sequence, self._made = _page(serving, sequence), sequence, now
            return self._page


def _page(serving: AppState, sequence: int) -> str:
    semantic_map = serving.semantic_map
    objects = semantic_map.ask("objects-surest").records()
    places = semantic_map.places()
    summary = semantic_map.ask("summary").records()
    base, description = semantic_map.base, semantic_map.description
    total = sum(int(str(row["count"])) for row in summary)

    def path(iri: str) -> str:
        return local_path(base, iri)

    spots = [_spot(row, path(str(row["object"]))) for row in objects]
    return front_page(
        title=description.title,
        licence=description.licence,
        base=base,
        sequence=sequence,
        floor=floor_plan(
            places, spots, semantic_map.robot(), lambda place: _category(serving, place)[0]
        ),
        numbers=[
            ("objects", total),
            ("categories", len(summary)),
            ("places", len(places)),
            ("triples of the map", graph_sizes(serving).get(MAP_GRAPH, 0)),
        ],
        objects=objects,
        places=[(place.iri, place.label, *_category(serving, place)) for place in places],
        questions=query_summaries(),
        writable=bool(serving.settings.tokens),
        path=path,
    )


def _spot(row: dict[str, Value], link: str) -> Spot:
    existence = row["existence"]
    x, y = float(str(row["x"])), float(str(row["y"]))
    tooltip = f"{row['label'] or row['category']} ({x:.2f}, {y:.2f})"
    sure = float(existence) if isinstance(existence, int | float) else 1.0
    return link, tooltip, str(row["category"]), x, y, sure


def _category(serving: AppState, place: PlaceRecord) -> tuple[str, str]:
    """Label and belief of a place's likeliest category."""
    if not place.beliefs:
        return place.label, ""
    best = max(place.beliefs, key=lambda iri: (place.beliefs[iri], iri))
    return serving.semantic_map.catalogue.label(best), f"{place.beliefs[best]:.2f}"
