"""Every IRI of the map as a page or a document: its facts, and the facts that refer to it.

``/object/17`` is ``<base>object/17``; ``/resource?iri=...`` is any other IRI of the graph.
"""

from __future__ import annotations

from functools import partial
from typing import Final

from pyoxigraph import Literal
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.export.serialization import prefixes_of
from kg.model import vocabulary as v
from kg.serving.server.app_state import AppState
from kg.serving.server.http import bodies
from kg.serving.server.http.media_types import HTML, document, negotiated
from kg.serving.server.http.problems import Problem, State
from kg.serving.server.linked_data.memento import VARY, links, memento
from kg.serving.server.linked_data.pages import compact, thing_page
from kg.serving.server.linked_data.resource_description import (
    ResourceDescription,
    local_path,
    look_up,
)

_GENID: Final = "/.well-known/genid/"


async def thing_at_path(serving: AppState, request: Request) -> Response:
    """The resource of the map whose IRI ends with the path of the request."""
    # IRIs keep their percent-encoding, so the path must not be decoded
    path = request.scope.get("raw_path", b"").decode("ascii", "replace").partition("?")[0]
    return await _answer(serving, request, serving.semantic_map.base + path.lstrip("/"))


async def resource(serving: AppState, request: Request) -> Response:
    """Any resource of the graph: ``/resource?iri=``."""
    iri = bodies.query_parameters(request).one("iri")
    if not iri:
        raise Problem(400, "needs ?iri=, an absolute IRI")
    return await _answer(serving, request, iri)


async def skolem(serving: AppState, request: Request) -> Response:
    """Skolem IRI of a blank node: ``/.well-known/genid/`` (RDF 1.1 Concepts, section 3.5)."""
    iri = v.GENID.partition(_GENID)[0] + _GENID + request.path_params["name"]
    return await _answer(serving, request, iri)


async def _answer(serving: AppState, request: Request, iri: str) -> Response:
    media_type = negotiated(request)
    then = await memento(serving, request, iri)
    if then is not None:
        thing, headers = then
        return await _written(serving, thing, media_type, headers)
    # before the facts are read: after a concurrent commit the tag is too old, never the facts
    state = State(serving.semantic_map.sequence)
    headers = {"Vary": VARY, **links(serving, request, iri)}
    try:
        thing = await serving.read(request, partial(look_up, serving.semantic_map, iri))
    except Problem as problem:
        problem.headers |= headers  # a removed resource may have versions
        raise
    headers |= state.headers
    if state.is_known_to(request):
        return Response(status_code=304, headers=headers)
    return await _written(serving, thing, media_type, headers)


async def _written(
    serving: AppState, thing: ResourceDescription, media_type: str, headers: dict[str, str]
) -> Response:
    if media_type == HTML:
        then = headers.get("Memento-Datetime", "")
        page = await run_in_threadpool(_page, serving, thing, then and f" on {then}")
        return Response(page, media_type=HTML, headers=headers)
    triples = dict.fromkeys(quad.triple for quad in (*thing.about, *thing.referring))
    body = document(triples, media_type, prefixes_of(serving.semantic_map.base))
    return Response(body, media_type=media_type, headers=headers)


def _page(serving: AppState, thing: ResourceDescription, when: str) -> str:
    base, catalogue = serving.semantic_map.base, serving.semantic_map.catalogue
    labels = [
        quad.object.value
        for quad in thing.about
        if quad.predicate.value == v.RDFS_LABEL and isinstance(quad.object, Literal)
    ]

    def link(iri: str) -> tuple[str, str]:
        known = catalogue.by_iri(iri)
        return local_path(base, iri), known.label if known else compact(iri, base)

    title = min(labels, default=compact(thing.iri, base)) + when
    return thing_page(thing, title, link, base, past=bool(when))
