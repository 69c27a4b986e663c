"""Writes of remote mappers and robots (`/records`, `/numbers`, `/labels`), and of people.

People edit rooms (`POST /rooms`) and restore a past state (`POST /restore`).

A POST to `/records` is one transaction of a frame or of a look. The response is sent once the
transaction is in the history, so an acknowledged write survives a crash of client or server.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any, Final

from pyoxigraph import NamedNode, Quad
from starlette.requests import Request
from starlette.responses import Response

from kg.export.serialization import prefixes_of
from kg.maps.conflict_check import apply_remote_update
from kg.maps.facts.assertions import NAME, PLACE_PROPERTIES, PROPERTIES, Assertions, is_unicode
from kg.model import vocabulary as v
from kg.model.records import Assertion
from kg.model.room_edit import RoomEdit
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.record_codec import assertion_to_json
from kg.serving.client.update_codec import MAX_WHOLE, update_from_json
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import written
from kg.serving.server.http.bodies import JSON, json_response, query_parameters, read_json
from kg.serving.server.http.media_types import document, negotiated
from kg.serving.server.http.problems import Problem, check_preconditions, sequence_at, state_of
from kg.serving.server.http.request_checks import is_confirmed
from kg.serving.server.linked_data.resource_description import local_path
from kg.serving.workers.content_negotiation import GRAPH_TYPES
from kg.store.sparql_client import SEQUENCE

#: kinds of causes: frames of a mapper, a search of a robot, an import
_KINDS: Final = ("frame", "search", "import")
_MAX_TEXT: Final = 500  # characters of a note, a label, the name of a network
#: a search, which is the author of its transactions
_SEARCH: Final = re.compile(r"search/[0-9]{1,15}")
_MAX_ITEMS: Final = 10_000  # labels, or own transactions, of one request

_MEMBERS: Final = ("kind", "places", "points", "name")

_MAX_THINGS: Final = 1000  # things of one request


async def records(serving: AppState, request: Request) -> Response:
    """Apply an update of records in one transaction; Problem 409 for a conflict with others."""
    by = serving.author_of(request)
    content = await read_json(request, serving.settings.limits, ("update", "cause", "seen", "own"))
    known, own = _known_sequence(content["seen"]), _own(content["own"])
    cause = _cause(content["cause"], by)

    def apply() -> ChangeSet | None:
        update = update_from_json(content["update"])
        return apply_remote_update(
            serving.semantic_map, update, cause, known_sequence=known, own=own
        )

    return written(serving, await serving.write(request, apply), request)


async def numbers(serving: AppState, request: Request) -> Response:
    """Reserve the IRI of a new object."""
    serving.author_of(request)
    await read_json(request, serving.settings.limits, ())
    return json_response({"iri": await serving.write(request, serving.semantic_map.new_object_iri)})


async def labels(serving: AppState, request: Request) -> Response:
    """Categories of the labels of a network; missing ones are added in one transaction."""
    serving.author_of(request)
    content = await read_json(request, serving.settings.limits, ("labels", "kind", "model"))
    names, kind = content["labels"], content["kind"]
    if not isinstance(names, list) or len(names) > _MAX_ITEMS or not all(map(_is_name, names)):
        raise Problem(
            400, f"'labels' must be a list of up to {_MAX_ITEMS} texts of up to {_MAX_TEXT}"
        )
    if kind not in ("object", "place"):
        raise Problem(400, f"'kind' is object or place, got {str(kind)[:100]!r}")
    if not _is_name(content["model"]):
        raise Problem(400, f"'model' must be the name of the network, of up to {_MAX_TEXT}")

    learn = partial(serving.semantic_map.ontology.learn, names, kind, model=content["model"])
    found = await serving.write(request, learn)
    serving.sessions.saw(request.state.client, serving.semantic_map.sequence)
    return json_response({"categories": found, "sequence": serving.semantic_map.sequence})


def _known_sequence(content: Any) -> int | None:
    if content is not None and not _is_number(content):
        raise Problem(
            400, f"'seen' is the number of a transaction, or null, got {str(content)[:40]}"
        )
    return None if content is None else int(content)


def _own(content: Any) -> frozenset[int]:
    is_list = isinstance(content, list) and len(content) <= _MAX_ITEMS
    if not is_list or not all(map(_is_number, content)):
        raise Problem(400, f"'own' must be a list of up to {_MAX_ITEMS} numbers of transactions")
    return frozenset(content)


def _cause(content: object, by: str) -> Cause:
    """Cause of a transaction; its author is the search, or else the holder of the token."""
    if not isinstance(content, dict) or set(content) != {"kind", "by", "note"}:
        raise Problem(400, "'cause' must be an object of kind, by and note")
    kind, name, note = content["kind"], content["by"], content["note"]
    if kind not in _KINDS:
        raise Problem(400, f"'kind' is one of {', '.join(_KINDS)}, got {str(kind)[:40]!r}")
    if not _is_text(note) or not (name is None or _is_text(name)):
        raise Problem(400, "'note' must be a text, 'by' a text or null")
    if kind != "search" or name is None:
        return Cause(kind, by, note[:_MAX_TEXT])
    if not _SEARCH.fullmatch(name):
        raise Problem(400, "'by' is the search, as in search/3: the token identifies the author")
    return Cause(kind, name, note[:_MAX_TEXT])


def _is_text(value: object) -> bool:
    return isinstance(value, str) and is_unicode(value)


def _is_name(value: object) -> bool:
    return _is_text(value) and len(str(value)) <= _MAX_TEXT


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_WHOLE


async def rooms(serving: AppState, request: Request) -> Response:
    """Apply the edit in the body: a JSON object with the members of `RoomEdit`."""
    by = serving.author_of(request)
    edit = _edit(**await read_json(request, serving.settings.limits, _MEMBERS))
    change = await serving.write(request, partial(serving.semantic_map.rooms.edit, edit, by=by))
    return written(serving, change, request)


def _edit(kind: Any, places: Any, points: Any, name: Any) -> RoomEdit:
    if not isinstance(kind, str) or not isinstance(name, str):
        raise Problem(400, "'kind' and 'name' must be texts")
    if not isinstance(places, list) or not all(isinstance(place, str) for place in places):
        raise Problem(400, "'places' must be a list of texts, as in [\"place/2\"]")
    if not isinstance(points, list) or not all(map(_is_point, points)):
        raise Problem(400, "'points' must be a list of [x, y] in metres")
    pairs = tuple((float(x), float(y)) for x, y in points)
    return RoomEdit(kind, tuple(places), pairs, name)  # type: ignore[arg-type]


def _is_point(given: Any) -> bool:
    return (
        isinstance(given, list)
        and len(given) == 2
        and all(isinstance(n, int | float) and not isinstance(n, bool) for n in given)
        and all(abs(n) <= 1e6 and math.isfinite(n) for n in given)
    )


async def restore(serving: AppState, request: Request) -> Response:
    """Restore the state at `to`; the response has the counts of `Restored`.

    The body is a JSON object: `to` a time or number of a transaction, `only` a list of scopes and
    things (empty: everything), `dry_run` a boolean.
    """
    by = serving.author_of(request)
    given = await read_json(request, serving.settings.limits, ("to", "only", "dry_run"))
    if not isinstance(given["to"], str) or not isinstance(given["dry_run"], bool):
        raise Problem(
            400,
            "'to' must be a text, as in #42 or 2026-08-01T12:30:00Z, and 'dry_run' true or false",
        )
    restoration = partial(
        serving.semantic_map.restore,
        await sequence_at(serving.semantic_map, given["to"]),
        only=_scopes(given["only"]),
        by=by,
        confirmed=is_confirmed(request),
        dry_run=given["dry_run"],
    )
    done = await serving.write(request, restoration)
    sequence = done.sequence or serving.semantic_map.sequence
    serving.sessions.saw(request.state.client, sequence)
    return json_response(asdict(done), {SEQUENCE: str(sequence)})


def _scopes(given: Any) -> Collection[str]:
    is_list = isinstance(given, list) and len(given) <= _MAX_THINGS
    if not is_list or not all(isinstance(name, str) for name in given):
        raise Problem(
            400, f"'only' must be a list of up to {_MAX_THINGS} texts, as in [\"object/17\"]"
        )
    return tuple(given)


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
        iri = full_iri(serving.semantic_map.base, serving.semantic_map.resolve("iri", iri))
    # a strong tag, which the If-Match of an edit can name
    state = replace(state_of(serving.semantic_map), form="json" if media_type == JSON else "")
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
    named, prop = _word(content, "thing"), _property(_word(content, "property"))
    value = _value(content["value"])

    def write() -> tuple[ChangeSet | None, Assertion]:
        semantic_map = serving.semantic_map
        with semantic_map.hold():
            check_preconditions(request, state_of(semantic_map), exists=True)
            thing = full_iri(base, semantic_map.resolve("iri", named))
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
    _property(prop)

    def retract() -> ChangeSet | None:
        semantic_map = serving.semantic_map
        with semantic_map.hold():
            check_preconditions(request, state_of(semantic_map), exists=True)
            thing = full_iri(semantic_map.base, semantic_map.resolve("iri", iri))
            return semantic_map.assertions.retract(thing, prop, by=by)

    return written(serving, await serving.write(request, retract), request)


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
    if isinstance(value, list) and len(value) == 3 and all(map(_is_finite, value)):
        return value
    raise Problem(400, f"'value' must be a text, or [x, y, z] in metres, got {str(value)[:100]!r}")


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def full_iri(base: str, iri: str) -> str:
    """The IRI of ``object/17`` or of an absolute IRI; Problem 400 for an invalid one."""
    try:
        return NamedNode(iri if ":" in iri else base + iri).value
    except ValueError as error:
        raise Problem(400, f"no thing {iri[:200]!r}; write object/17 or its IRI") from error
