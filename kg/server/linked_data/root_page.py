"""`/`: the map itself, as a page for people or as its description for programs."""

from __future__ import annotations

import threading
import time
from functools import partial

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.query.query_files import query_summaries
from kg.server.app_state import AppState
from kg.server.http.bodies import query_parameters
from kg.server.http.media_types import GRAPH_FORMATS, HTML, accept_of
from kg.server.linked_data.description import dataset_description
from kg.server.linked_data.pages import front_page
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
    description = serving.semantic_map.description
    return front_page(
        title=description.title,
        licence=description.licence,
        base=serving.semantic_map.base,
        sequence=sequence,
        questions=query_summaries(),
        writable=bool(serving.settings.tokens),
    )
