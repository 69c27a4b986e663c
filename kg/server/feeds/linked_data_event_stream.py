"""`/changes` as a Linked Data Event Stream: change sets in pages of the TREE hypermedia vocabulary.

A page, ``?page=N``, holds the transactions of a fixed range of numbers, so a full one is immutable.
A member is a cs:ChangeSet (Talis' Changeset vocabulary) whose additions and removals are reified
statements, each part of its named graph.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import takewhile
from typing import Final

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, Triple
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg import vocabulary as v
from kg.facts.agents import agent_iri
from kg.rdf.datetimes import date_time
from kg.server.app_state import AppState
from kg.server.http.bodies import query_parameters
from kg.server.http.media_types import document, prefixes_of
from kg.server.http.problems import Problem
from kg.server.linked_data.derived_resources import COMMIT
from kg.transactions import ChangeSet

PAGE: Final = 100  # transactions of a page
_Fact = tuple[NamedNode | BlankNode, str, NamedNode | BlankNode | Literal]


async def change_pages(serving: AppState, request: Request, media_type: str) -> Response:
    """The stream's description, or its page ``?page=``, from 0.

    Raises Problem: 400 for no number, 404 for a page that is yet to come, 410 for one that is no
    longer kept.
    """
    last, floor = serving.semantic_map.sequence, serving.semantic_map.history.floor
    stream = f"{request.base_url}changes"
    page = _page(query_parameters(request).one("page"))
    if page is None:
        facts = _described(stream, floor // PAGE)
        body = await run_in_threadpool(partial(_document, serving, facts, media_type))
        return _response(body, media_type, "no-cache")
    if page * PAGE > last:
        raise Problem(404, f"no page {page} yet; the last is {last // PAGE}")
    first = max(page * PAGE, 1)
    changes = serving.feed.since(max(first - 1, floor if page == floor // PAGE else 0))
    facts = _of_page(serving.semantic_map.base, stream, page, last // PAGE > page, changes)
    body = await run_in_threadpool(partial(_document, serving, facts, media_type))
    full = last // PAGE > page
    return _response(body, media_type, "max-age=604800, immutable" if full else "no-cache")


def _response(body: bytes, media_type: str, cache: str) -> Response:
    headers = {"Vary": "Accept", "Cache-Control": cache}
    return Response(body, media_type=media_type, headers=headers)


def _page(text: str | None) -> int | None:
    if text is not None and not re.fullmatch(r"[0-9]{1,15}", text):
        raise Problem(400, f"page must be a number, got {text[:40]!r}")
    return None if text is None else int(text)


def _document(serving: AppState, facts: Iterable[_Fact], media_type: str) -> bytes:
    triples = dict.fromkeys(Triple(s, NamedNode(p), o) for s, p, o in facts)
    return document(triples, media_type, prefixes_of(serving.semantic_map.base))


def _described(stream: str, first: int) -> Iterator[_Fact]:
    node, view = NamedNode(stream), NamedNode(f"{stream}?page={first}")
    yield node, v.RDF_TYPE, NamedNode(v.LDES_EVENT_STREAM)
    yield node, v.LDES_TIMESTAMP_PATH, NamedNode(v.CS_CREATED)
    yield node, v.TREE_VIEW, view
    yield view, v.RDF_TYPE, NamedNode(v.TREE_NODE)


def _of_page(
    base: str, stream: str, page: int, more: bool, changes: Iterable[ChangeSet]
) -> Iterator[_Fact]:
    """Members of a page, and the relation to the page behind it."""
    node, end = NamedNode(f"{stream}?page={page}"), (page + 1) * PAGE
    yield NamedNode(stream), v.RDF_TYPE, NamedNode(v.LDES_EVENT_STREAM)
    yield NamedNode(stream), v.TREE_VIEW, node
    yield node, v.RDF_TYPE, NamedNode(v.TREE_NODE)
    if more:
        relation = BlankNode("next")
        yield node, v.TREE_RELATION, relation
        yield relation, v.RDF_TYPE, NamedNode(v.TREE_GREATER_OR_EQUAL)
        yield relation, v.TREE_NODE_OF, NamedNode(f"{stream}?page={page + 1}")
        yield relation, v.TREE_PATH, NamedNode(v.SEQUENCE)
        yield relation, v.TREE_VALUE, Literal(end)
    for change in takewhile(lambda change: change.sequence < end, changes):
        member = NamedNode(f"{base}{COMMIT}{change.sequence}")
        yield NamedNode(stream), v.TREE_MEMBER, member
        yield from _of_change(base, member, change)


def _of_change(base: str, member: NamedNode, change: ChangeSet) -> Iterator[_Fact]:
    yield member, v.RDF_TYPE, NamedNode(v.CS_CHANGE_SET)
    yield member, v.SEQUENCE, Literal(change.sequence)
    yield member, v.CS_CREATED, date_time(change.time)
    yield member, v.CS_REASON, Literal(f"{change.cause.kind} {change.cause.note}".strip())
    if change.cause.by:
        yield member, v.CS_CREATOR, Literal(change.cause.by)
        yield member, v.PROV_ASSOCIATED_WITH, NamedNode(agent_iri(base, change.cause.by))
    for index, quad in enumerate(change.removed):
        statement = BlankNode(f"removal{change.sequence}x{index}")
        yield from _reified(member, v.CS_REMOVAL, statement, quad)
    for index, quad in enumerate(change.added):
        statement = BlankNode(f"addition{change.sequence}x{index}")
        yield from _reified(member, v.CS_ADDITION, statement, quad)


def _reified(
    member: NamedNode, predicate: str, statement: BlankNode, quad: Quad
) -> Iterator[_Fact]:
    yield member, predicate, statement
    yield statement, v.RDF_TYPE, NamedNode(v.RDF_STATEMENT)
    parts = (v.RDF_SUBJECT, quad.subject), (v.RDF_PREDICATE, quad.predicate)
    for part, term in (*parts, (v.RDF_OBJECT, quad.object), (v.DCT_PART_OF, quad.graph_name)):
        yield statement, part, term  # type: ignore[misc]
