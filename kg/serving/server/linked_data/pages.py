"""The HTML pages: the map's front page at `/`, the console, and a page for a resource.

Every IRI of the map has a page or a document: its facts, and the facts that refer to it.
``/object/17`` is ``<base>object/17``; ``/resource?iri=...`` is any other IRI of the graph.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from html import escape
from importlib.resources import files
from string import Template
from typing import Final
from urllib.parse import quote

from pyoxigraph import BlankNode, Literal, NamedNode, Quad
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.export.serialization import prefixes_of
from kg.model import vocabulary as v
from kg.rdf.literals import shown
from kg.serving.server.app_state import AppState
from kg.serving.server.http import bodies
from kg.serving.server.http.media_types import HTML, document, negotiated
from kg.serving.server.http.middleware import is_admitted, private_map
from kg.serving.server.http.problems import Problem, State
from kg.serving.server.linked_data.descriptions import (
    ResourceDescription,
    dataset_description,
    local_path,
    look_up,
)
from kg.serving.server.linked_data.memento import VARY, links, memento

#: IRI -> its address on this server, and its name.
Link = Callable[[str], tuple[str, str]]
_FIRST: Final = {v.RDFS_LABEL: 0, v.RDF_TYPE.value: 1}
#: classes of what is drawn on no map, and has reasons and a history
_WITH_HISTORY: Final = frozenset(
    map(NamedNode, (v.DEPARTED_OBJECT, v.DOOR, v.ROBOT, v.SEARCH, v.LOOK))
)
_TOKEN_FORM: Final = (
    '<section id="editing" class="hidden" aria-label="edit"><form id="corrector">'
    "<label>token for corrections "
    '<input id="token" type="password" autocomplete="off"></label> '
    '<button type="submit">use</button></form><div id="tools"></div>'
    '<datalist id="object-categories"></datalist><datalist id="place-categories"></datalist>'
    "</section>"
)
_ENTRY_FORM: Final = (
    '<form id="entry" class="panel"><label>This map is private. Token: '
    '<input id="entry-token" type="password" autocomplete="off" required></label> '
    '<button type="submit" class="primary">open</button> '
    '<span id="entry-outcome" role="status"></span></form>'
)


@dataclass(frozen=True, slots=True)
class MapHead:
    """Head of the pages of a map; a `private` map asks for a token first."""

    title: str
    base: str
    sequence: int
    licence: str | None = None
    private: bool = False


def front_page(of: MapHead, *, writable: bool) -> str:
    """The page of the live map, which scripts fill."""
    page = template("front.html").substitute(
        head=head(of.title),
        preload=_preload() + (_PRELOAD_STATE if not of.private else ""),
        title=escape(of.title),
        base=escape(of.base),
        sequence=of.sequence,
        entry=_ENTRY_FORM if of.private else "",
        licence=_licence(of.licence),
        access="updates with a token" if writable else "reading only",
        correction=_TOKEN_FORM if writable else "",
    )
    return shown(page)


#: the first requests of the map's page, begun before its scripts are there
_PRELOAD_STATE: Final = (
    '<link rel="preload" href="/state?" as="fetch" crossorigin>'
    '<link rel="preload" href="/surface" as="fetch" crossorigin>'
)


@cache
def _preload() -> str:
    """Elements by which a browser loads all scripts of the map's page at once, not one by one."""
    found, waiting = dict[str, None](), ["map-page.js"]
    while waiting:
        name = waiting.pop()
        found[name] = None
        text = files("kg.serving.server").joinpath("files", name).read_text(encoding="utf-8")
        imported = re.findall(r'^import .*from "/files/([\w./-]+)";$', text, re.MULTILINE)
        waiting += [one for one in imported if one not in found and one not in waiting]
    return "".join(f'<link rel="modulepreload" href="/files/{name}">' for name in sorted(found))


def console_html(of: MapHead) -> str:
    """The page with a SPARQL editor; without scripts it is a plain form."""
    page = template("console.html").substitute(
        head=head(f"ask {of.title}"),
        title=escape(of.title),
        base=escape(of.base),
        entry=_ENTRY_FORM if of.private else "",
    )
    return shown(page)


def _licence(iri: str | None) -> str:
    if iri is None:
        return ""
    text = escape(iri)
    # links to web pages only: a browser could run the script in another scheme
    web = iri.startswith(("http://", "https://"))
    return f' · licence <a rel="license" href="{text}">{text}</a>' if web else f" · licence {text}"


def thing_page(
    thing: ResourceDescription, title: str, link: Link, base: str, *, past: bool = False
) -> str:
    """The page of a resource: its facts, and the facts that refer to it.

    A thing on the map has a small map, its picture, reasons and history first, except in the past;
    so has one that left, a door, the robot, a search and its looks.
    """
    about = sorted((q for q in thing.about if _is(q.subject, thing.iri)), key=_order)
    facts = "".join(_fact(quad.predicate.value, _term(quad.object, link), link) for quad in about)
    pointing = "".join(
        _fact(quad.predicate.value, _term(quad.subject, link), link) for quad in thing.referring
    )
    address, live = link(thing.iri)[0], "" if past else _live(thing, base)
    page = template("thing.html").substitute(
        head=head(title),
        title=escape(title),
        iri=escape(thing.iri),
        turtle=escape(f"{address}{'&' if '?' in address else '?'}format=ttl"),
        place=_on_the_map(thing, base),
        live=live,
        open="" if live else "open",
        facts=facts,
        pointing=pointing,
        pointing_class="" if pointing else "hidden",
    )
    return shown(page)


def _on_the_map(thing: ResourceDescription, base: str) -> str:
    """A link to the thing on the live map; empty for a thing without a position."""
    if not _is_on_map(thing):
        return ""
    name = quote(thing.iri.removeprefix(base), safe="/:@")
    return f'<p><a class="primary" href="/#{escape(name)}">Show it on the map</a></p>'


def _is_on_map(thing: ResourceDescription) -> bool:
    stated = {quad.predicate.value for quad in thing.about if _is(quad.subject, thing.iri)}
    return {v.X, v.Y, v.EXISTENCE} <= stated or v.X_MIN in stated


def _live(thing: ResourceDescription, base: str) -> str:
    """The part of a page that scripts fill; empty for what is not of the map."""
    about = [quad for quad in thing.about if _is(quad.subject, thing.iri)]
    kinds = {quad.object for quad in about if quad.predicate == v.RDF_TYPE}
    if not _is_on_map(thing) and not kinds & _WITH_HISTORY:
        return ""
    stated = {quad.predicate.value: quad.object for quad in about}
    at = [x.value for x in map(stated.get, (v.X, v.Y)) if isinstance(x, Literal)]
    return template("thing-live.html").substitute(
        base=escape(base), iri=escape(thing.iri), at=escape(" ".join(at) if len(at) == 2 else "")
    )


def compact(iri: str, base: str) -> str:
    """An IRI as a prefixed name if a prefix fits; IRIs of the map without its base."""
    if iri.startswith(base) and iri != base:
        return iri.removeprefix(base)
    fitting = [(len(ns), name) for name, ns in v.PREFIXES.items() if iri.startswith(ns)]
    if not fitting:
        return iri
    length, name = max(fitting)
    return f"{name}:{iri[length:]}"


def template(name: str) -> Template:
    """A shipped page as a template."""
    return Template(files("kg.serving.server").joinpath("files", name).read_text(encoding="utf-8"))


def head(title: str) -> str:
    """The head element of every page."""
    return template("head.html").substitute(title=escape(title))


def _is(term: object, iri: str) -> bool:
    return isinstance(term, NamedNode) and term.value == iri


def _order(quad: Quad) -> tuple[int, str, str]:
    return _FIRST.get(quad.predicate.value, 2), quad.predicate.value, str(quad.object)


def _fact(predicate: str, value: str, link: Link) -> str:
    href, name = link(predicate)
    return f'<tr><th><a href="{escape(href)}">{escape(name)}</a></th><td>{value}</td></tr>'


def _term(term: object, link: Link) -> str:
    if isinstance(term, NamedNode):
        href, name = link(term.value)
        return f'<a href="{escape(href)}" title="{escape(term.value)}">{escape(name)}</a>'
    if isinstance(term, BlankNode):
        return '<span class="dim">(unnamed)</span>'
    if isinstance(term, Literal):
        kind = term.language or term.datatype.value.rpartition("#")[2]
        mark = "" if kind == "string" else f' <span class="dim">{escape(kind)}</span>'
        return f"{escape(term.value)}{mark}"
    return escape(str(term))


_UNKNOWN = MapHead(title="a private map", base="", sequence=0, private=True)


async def root_page(serving: AppState, request: Request) -> Response:
    """The page, or VoID and DCAT if the client accepts RDF."""
    media_type = negotiated(request)
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
