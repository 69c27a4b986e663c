"""Every IRI of the map as a page or a document: what the graph says of it, and what points at it.

``/object/17`` is ``<base>object/17``; ``/resource?iri=...`` is any other IRI the graph knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Final
from urllib.parse import quote

from pyoxigraph import BlankNode, Literal, NamedNode, Quad
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg import vocabulary as v
from kg.engine import Engine
from kg.server import bodies
from kg.server.conditions import state_of
from kg.server.media_types import GRAPH_FORMATS, HTML, document, prefixes_of
from kg.server.pages import compact, thing_page
from kg.server.problems import Problem
from kg.server.serving import Serving
from kg.workers.formats import negotiate

MOST_OUT: Final = 1000  # facts of one thing that are shown
MOST_IN: Final = 200  # and facts that point at it
_SAFE_PATH: Final = "/:@!$&'()*+,;=-._~%"


@dataclass(frozen=True, slots=True)
class Thing:
    """A thing and the facts it stands in; `about` holds those of blank nodes it names as well."""

    iri: str
    about: tuple[Quad, ...]
    pointing: tuple[Quad, ...]


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


def look_up(engine: Engine, iri: str) -> Thing:
    """What the graph says of `iri`; Problem 404 where it says nothing."""
    try:
        node = NamedNode(iri)
    except ValueError as error:
        raise Problem(404, f"{iri[:200]!r} is no IRI this map could know") from error
    about = list(islice(engine.quads_for_pattern(node, None, None), MOST_OUT))
    for quad in about:
        if isinstance(quad.object, BlankNode) and len(about) < MOST_OUT:
            about += islice(engine.quads_for_pattern(quad.object, None, None), MOST_OUT)
    pointing = tuple(islice(engine.quads_for_pattern(None, None, node), MOST_IN))
    if not about and not pointing:
        raise Problem(404, f"this map knows of no {iri[:200]}")
    return Thing(iri, tuple(about), pointing)


def local_path(base: str, iri: str) -> str:
    """Where this server shows an IRI."""
    if iri.startswith(base):
        return "/" + quote(iri.removeprefix(base), safe=_SAFE_PATH)
    return "/resource?iri=" + quote(iri, safe="")


async def _answer(serving: Serving, request: Request, iri: str) -> Response:
    media_type = negotiate(request.headers.get("accept"), (*GRAPH_FORMATS, HTML))
    # before anything is read: a commit meanwhile makes the tag too old, never the answer
    state = state_of(serving.semantic_map)
    thing = await run_in_threadpool(look_up, serving.semantic_map.engine, iri)
    headers = {"Vary": "Accept", **state.headers}
    if state.is_known_to(request):
        return Response(status_code=304, headers=headers)
    if media_type == HTML:
        page = await run_in_threadpool(_page, serving, thing)
        return Response(page, media_type=HTML, headers=headers)
    triples = dict.fromkeys(quad.triple for quad in (*thing.about, *thing.pointing))
    body = document(triples, media_type, prefixes_of(serving.semantic_map.base))
    return Response(body, media_type=media_type, headers=headers)


def _page(serving: Serving, thing: Thing) -> str:
    base, catalogue = serving.semantic_map.base, serving.semantic_map.catalogue
    labels = [
        quad.object.value
        for quad in thing.about
        if quad.predicate.value == v.RDFS_LABEL and isinstance(quad.object, Literal)
    ]

    def link(iri: str) -> tuple[str, str]:
        known = catalogue.by_iri(iri)
        return local_path(base, iri), known.label if known else compact(iri, base)

    return thing_page(thing, min(labels, default=compact(thing.iri, base)), link)
