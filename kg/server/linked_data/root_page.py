"""`/`: the map itself, as a page for people or as its description for programs."""

from __future__ import annotations

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


async def root_page(serving: AppState, request: Request) -> Response:
    """The page, or VoID and DCAT where the client accepts RDF."""
    media_type = negotiate(accept_of(request, query_parameters(request)), (*GRAPH_FORMATS, HTML))
    if media_type != HTML:
        return await dataset_description(serving, request)
    page = await run_in_threadpool(_page, serving)
    return Response(page, media_type=HTML, headers={"Vary": "Accept"})


def _page(serving: AppState) -> str:
    description = serving.semantic_map.description
    return front_page(
        title=description.title,
        licence=description.licence,
        base=serving.semantic_map.base,
        sequence=serving.semantic_map.sequence,
        questions=query_summaries(),
        writable=bool(serving.settings.tokens),
    )
