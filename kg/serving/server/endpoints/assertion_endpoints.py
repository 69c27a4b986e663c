"""`/assertions`: GET lists assertions, POST with a JSON object makes one, DELETE retracts one.

The author is the holder of the token.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any, Final

from pyoxigraph import NamedNode, Quad
from starlette.requests import Request
from starlette.responses import Response

from kg.export.serialization import prefixes_of
from kg.maps.facts.assertions import (
    NAME,
    PLACE_PROPERTIES,
    PROPERTIES,
    Assertions,
    is_unicode,
)
from kg.model import vocabulary as v
from kg.model.records import Assertion
from kg.model.transactions import ChangeSet
from kg.serving.client.record_codec import assertion_to_json
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import written
from kg.serving.server.http.bodies import JSON, json_response, query_parameters, read_json
from kg.serving.server.http.conditions import state_of
from kg.serving.server.http.media_types import document, negotiated
from kg.serving.server.http.problems import Problem
from kg.serving.server.linked_data.resource_description import local_path
from kg.serving.workers.content_negotiation import GRAPH_TYPES

_KIND: Final = NamedNode(v.ASSERTION)
_AGENT: Final = NamedNode(v.PROV_ATTRIBUTED_TO)


async def assertions(serving: AppState, request: Request) -> Response:
    """List assertions, make one, or retract one."""
    if request.method in ("GET", "HEAD"):
        return await _list(serving, request)
    by = serving.author_of(request)
    if request.method == "POST":
        return await _assert(serving, request, by)
    return await _retract(serving, request, by)


async def _list(serving: AppState, request: Request) -> Response:
    given = query_parameters(request)
    media_type = negotiated(request, given, (JSON, *GRAPH_TYPES))
    iri, conflicts = given.one("iri"), given.flag("conflicts")
    if iri is not None:
        iri = full_iri(serving.semantic_map.base, iri)
    state = state_of(serving.semantic_map)
    headers = {"Vary": "Accept", **state.headers}
    if state.is_known_to(request):
        return Response(status_code=304, headers=headers)
    response = await serving.read(request, partial(_listed, serving, iri, conflicts, media_type))
    response.headers.update(headers)
    return response


def _listed(serving: AppState, iri: str | None, conflicts: bool, media_type: str) -> Response:
    semantic_map = serving.semantic_map
    found = [a for a in semantic_map.assertions.all(iri) if not conflicts or a.since is not None]
    if media_type == JSON:
        content = [assertion_to_json(assertion) for assertion in found]
        return json_response({"sequence": semantic_map.sequence, "assertions": content})
    triples = dict.fromkeys(quad.triple for quad in _facts(serving, found))
    body = document(triples, media_type, prefixes_of(semantic_map.base))
    return Response(body, media_type=media_type)


def _facts(serving: AppState, found: Iterable[Assertion]) -> Iterable[Quad]:
    """The quads of graph:assertions about these assertions and their authors."""
    engine, ours = serving.semantic_map.engine, Assertions(serving.semantic_map.base)
    for assertion in found:
        node = ours.iri(assertion.subject, assertion.property)
        for quad in ours.stored(engine, assertion.subject):
            about = getattr(quad.subject, "value", "")
            if about == node or about.startswith(f"{node}/"):
                yield quad
            if about == node and quad.predicate == _AGENT and isinstance(quad.object, NamedNode):
                yield from engine.quads_for_pattern(quad.object, None, None, v.ASSERTIONS_GRAPH)


async def _assert(serving: AppState, request: Request, by: str) -> Response:
    content = await read_json(request, serving.settings.limits, ("thing", "property", "value"))
    base = serving.semantic_map.base
    thing, prop = full_iri(base, _word(content, "thing")), _property(_word(content, "property"))
    value = _value(content["value"])

    def write() -> tuple[ChangeSet | None, Assertion]:
        semantic_map = serving.semantic_map
        with semantic_map.hold():
            change = semantic_map.assertions.add(thing, prop, value, by=by)
            assertions = {a.property: a for a in semantic_map.assertions.all(thing)}
            return change, assertions["category" if prop == NAME else prop]

    change, assertion = await serving.write(request, write)
    answer = written(serving, change, request, assertion=assertion_to_json(assertion))
    if change is not None and any(quad.object == _KIND for quad in change.added):
        answer.status_code = 201
        ours = Assertions(serving.semantic_map.base)
        path = local_path(
            serving.semantic_map.base, ours.iri(assertion.subject, assertion.property)
        )
        answer.headers["Location"] = path
    return answer


async def _retract(serving: AppState, request: Request, by: str) -> Response:
    given = query_parameters(request)
    iri, prop = given.one("iri"), given.one("property")
    if not iri or not prop:
        raise Problem(400, "a retraction needs ?iri= and &property=, as in iri=object/17")
    thing = full_iri(serving.semantic_map.base, iri)
    _property(prop)
    change = await serving.write(
        request, partial(serving.semantic_map.assertions.retract, thing, prop, by=by)
    )
    return written(serving, change, request)


def _word(content: Mapping[str, Any], name: str) -> str:
    value = content[name]
    if not isinstance(value, str) or not value.strip():
        raise Problem(400, f"{name!r} must be a text, got {str(value)[:100]!r}")
    return value.strip()


def _property(name: str) -> str:
    if name not in (*PROPERTIES, *PLACE_PROPERTIES, NAME):
        raise Problem(422, f"{name[:100]!r} cannot be asserted; these can: {', '.join(PROPERTIES)}")
    return name


def _value(value: object) -> object:
    """A text or a list of three numbers; Problem 400 for another value."""
    if isinstance(value, str) and is_unicode(value):
        return value
    if isinstance(value, list) and len(value) == 3 and all(map(_is_number, value)):
        return value
    raise Problem(400, f"'value' must be a text, or [x, y, z] in metres, got {str(value)[:100]!r}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def full_iri(base: str, iri: str) -> str:
    """The IRI of ``object/17`` or of an absolute IRI; Problem 400 for an invalid one."""
    try:
        return NamedNode(iri if ":" in iri else base + iri).value
    except ValueError as error:
        raise Problem(400, f"no thing {iri[:200]!r}; write object/17 or its IRI") from error
