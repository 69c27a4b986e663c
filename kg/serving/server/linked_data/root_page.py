"""`/`: the map as a page for browsers or a description for programs; `/console`."""

from __future__ import annotations

from functools import partial

from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import query_parameters
from kg.serving.server.http.media_types import HTML, negotiated
from kg.serving.server.http.request_checks import is_admitted, private_map
from kg.serving.server.linked_data.description import dataset_description
from kg.serving.server.linked_data.pages import MapHead, console_html, front_page

_UNKNOWN = MapHead(title="a private map", base="", sequence=0, private=True)


async def root_page(serving: AppState, request: Request) -> Response:
    """The page, or VoID and DCAT if the client accepts RDF."""
    media_type = negotiated(request, query_parameters(request))
    if media_type != HTML:
        if not is_admitted(serving.settings, request.headers):
            raise private_map()
        return await dataset_description(serving, request)
    head = await serving.read(request, partial(_head, serving, request))
    page = front_page(head, writable=bool(serving.settings.tokens))
    return Response(page, media_type=HTML, headers={"Vary": "Accept, Authorization"})


async def console_page(serving: AppState, request: Request) -> Response:
    """The page with a SPARQL editor."""
    page = console_html(await serving.read(request, partial(_head, serving, request)))
    return Response(page, media_type=HTML, headers={"Vary": "Authorization"})


def _head(serving: AppState, request: Request) -> MapHead:
    """Head of the page; empty for a client that may not read the map."""
    if not is_admitted(serving.settings, request.headers):
        return _UNKNOWN
    semantic_map = serving.semantic_map
    description = semantic_map.description
    return MapHead(
        title=description.title,
        base=semantic_map.base,
        sequence=semantic_map.sequence,
        licence=description.licence,
    )
