"""Every IRI of the map as a page or a document: what the graph says of it, and what points at it.

``/object/17`` is ``<base>object/17``; ``/resource?iri=...`` is any other IRI the graph knows.
"""

from __future__ import annotations

from pyoxigraph import Literal
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg import vocabulary as v
from kg.server import bodies
from kg.server.conditions import state_of
from kg.server.media_types import GRAPH_FORMATS, HTML, document, prefixes_of
from kg.server.memento import VARY, links, memento
from kg.server.pages import compact, thing_page
from kg.server.problems import Problem
from kg.server.serving import Serving
from kg.server.thing import Thing, local_path, look_up
from kg.workers.formats import negotiate


async def thing_at_path(serving: Serving, request: Request) -> Response:
    """The thing of the map whose IRI ends in the request's path."""
    # an IRI keeps the escapes it was written with, so the path is taken as it came
    path = request.scope.get("raw_path", b"").decode("ascii", "replace").partition("?")[0]
    return await _answer(serving, request, serving.semantic_map.base + path.lstrip("/"))


async def resource(serving: Serving, request: Request) -> Response:
    """Anything the graph knows: ``/resource?iri=``."""
    iri = bodies.query_parameters(request).one("iri")
    if not iri:
        raise Problem(400, "needs ?iri=, an absolute IRI")
    return await _answer(serving, request, iri)


async def _answer(serving: Serving, request: Request, iri: str) -> Response:
    media_type = negotiate(request.headers.get("accept"), (*GRAPH_FORMATS, HTML))
    then = await memento(serving, request, iri)
    if then is not None:
        return await _written(serving, then.thing, media_type, then.headers)
    # before anything is read: a commit meanwhile makes the tag too old, never the answer
    state = state_of(serving.semantic_map)
    headers = {"Vary": VARY, **links(serving, request, iri)}
    try:
        thing = await run_in_threadpool(look_up, serving.semantic_map.engine, iri)
    except Problem as problem:
        problem.headers |= headers  # what is gone may have been there
        raise
    headers |= state.headers
    if state.is_known_to(request):
        return Response(status_code=304, headers=headers)
    return await _written(serving, thing, media_type, headers)


async def _written(
    serving: Serving, thing: Thing, media_type: str, headers: dict[str, str]
) -> Response:
    if media_type == HTML:
        then = headers.get("Memento-Datetime", "")
        page = await run_in_threadpool(_page, serving, thing, then and f" on {then}")
        return Response(page, media_type=HTML, headers=headers)
    triples = dict.fromkeys(quad.triple for quad in (*thing.about, *thing.pointing))
    body = document(triples, media_type, prefixes_of(serving.semantic_map.base))
    return Response(body, media_type=media_type, headers=headers)


def _page(serving: Serving, thing: Thing, when: str) -> str:
    base, catalogue = serving.semantic_map.base, serving.semantic_map.catalogue
    labels = [
        quad.object.value
        for quad in thing.about
        if quad.predicate.value == v.RDFS_LABEL and isinstance(quad.object, Literal)
    ]

    def link(iri: str) -> tuple[str, str]:
        known = catalogue.by_iri(iri)
        return local_path(base, iri), known.label if known else compact(iri, base)

    return thing_page(thing, min(labels, default=compact(thing.iri, base)) + when, link)
