"""Writes of remote mappers and robots (`/records`, `/numbers`, `/labels`), and of people.

People edit rooms (`POST /rooms`) and restore a past state (`POST /restore`).

A POST to `/records` is one transaction of a frame or of a look. The response is sent once the
transaction is in the history, so an acknowledged write survives a crash of client or server.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Any, Final, Literal, TypeVar

from pyoxigraph import NamedNode, Quad
from starlette.requests import Request
from starlette.responses import Response

from kg.export.serialization import prefixes_of
from kg.maps.conflict_check import apply_remote_update
from kg.maps.facts.assertions import Assertions, is_unicode, kept_property
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import Assertion
from kg.model.room_edit import RoomEdit
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.record_codec import assertion_to_json
from kg.serving.client.update_codec import codec_of, update_from_json
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import written
from kg.serving.server.http.bodies import JSON, json_response, query_parameters, read_json
from kg.serving.server.http.media_types import document, negotiated
from kg.serving.server.http.middleware import is_confirmed
from kg.serving.server.http.problems import Problem, State, check_preconditions, sequence_at
from kg.serving.server.linked_data.descriptions import local_path
from kg.serving.workers.content_negotiation import GRAPH_TYPES
from kg.store.sparql_client import SEQUENCE

_MAX_TEXT: Final = 500  # characters of a note
#: a search, which is the author of its transactions
_SEARCH: Final = re.compile(r"search/[0-9]{1,15}")

_MAX_THINGS: Final = 1000  # things of one request

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class WriterCause:
    """Cause of a remote writer's transaction; `by` is its search."""

    kind: Literal["frame", "search", "import"]
    by: str | None
    note: str


@dataclass(frozen=True, slots=True)
class RemoteWriter:
    """A remote writer has read up to one transaction of others, and made its own since then."""

    cause: WriterCause
    seen: int | None
    own: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class NetworkLabels:
    """Body of `/labels`: the labels of a network, the kind of what they name, its name."""

    labels: tuple[str, ...]
    kind: Literal["object", "place"]
    model: str


@dataclass(frozen=True, slots=True)
class RestoreRequest:
    """Body of `/restore`: a time or number of a transaction, and scopes and things or none."""

    to: str
    only: tuple[str, ...]
    dry_run: bool


def _decoded(kind: type[T], content: Mapping[str, Any]) -> T:
    """A body as a dataclass; Problem 400 for other members, or values of another type."""
    try:
        body: T = codec_of(kind).decode(content, "the body")  # type: ignore[arg-type]
    except InvalidFactError as error:
        raise Problem(400, str(error)) from error
    return body


async def _body(serving: AppState, request: Request, kind: type[T]) -> T:
    members = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    return _decoded(kind, await read_json(request, serving.settings.limits, members))


async def records(serving: AppState, request: Request) -> Response:
    """Apply an update of records in one transaction; Problem 409 for a conflict with others."""
    by = serving.author_of(request)
    members = ("update", "cause", "seen", "own")
    content = await read_json(request, serving.settings.limits, members)
    told = {name: content[name] for name in ("cause", "seen", "own")}
    writer = _decoded(RemoteWriter, told)
    cause = _cause(writer.cause, by)
    if writer.seen is not None and writer.seen < 0:
        raise Problem(400, f"'seen' is the number of a transaction, or null, got {writer.seen}")

    def apply() -> ChangeSet | None:
        update = update_from_json(content["update"])
        return apply_remote_update(
            serving.semantic_map, update, cause, known_sequence=writer.seen, own={*writer.own}
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
    given = await _body(serving, request, NetworkLabels)
    ontology = serving.semantic_map.ontology
    learn = partial(ontology.learn, given.labels, given.kind, model=given.model)
    found = await serving.write(request, learn)
    serving.sessions.saw(request.state.client, serving.semantic_map.sequence)
    return json_response({"categories": found, "sequence": serving.semantic_map.sequence})


def _cause(given: WriterCause, by: str) -> Cause:
    """Cause of a transaction; its author is the search, or else the holder of the token."""
    note = given.note[:_MAX_TEXT]
    if given.kind != "search" or given.by is None:
        return Cause(given.kind, by, note)
    if not _SEARCH.fullmatch(given.by):
        raise Problem(400, "'by' is the search, as in search/3: the token identifies the author")
    return Cause("search", given.by, note)


async def rooms(serving: AppState, request: Request) -> Response:
    """Apply the edit in the body: a JSON object with the members of `RoomEdit`."""
    by = serving.author_of(request)
    edit = await _body(serving, request, RoomEdit)
    change = await serving.write(request, partial(serving.semantic_map.rooms.edit, edit, by=by))
    return written(serving, change, request)


async def restore(serving: AppState, request: Request) -> Response:
    """Restore the state at `to`; the response has the counts of `Restored`.

    The body is a JSON object: `to` a time or number of a transaction, `only` a list of scopes and
    things (empty: everything), `dry_run` a boolean.
    """
    by = serving.author_of(request)
    given = await _body(serving, request, RestoreRequest)
    if len(given.only) > _MAX_THINGS:
        raise Problem(400, f"'only' must be a list of up to {_MAX_THINGS} texts")
    restoration = partial(
        serving.semantic_map.restore,
        await sequence_at(serving.semantic_map, given.to),
        only=given.only,
        by=by,
        confirmed=is_confirmed(request),
        dry_run=given.dry_run,
    )
    done = await serving.write(request, restoration)
    sequence = done.sequence or serving.semantic_map.sequence
    serving.sessions.saw(request.state.client, sequence)
    return json_response(asdict(done), {SEQUENCE: str(sequence)})


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
    media_type = negotiated(request, (JSON, *GRAPH_TYPES))
    iri, conflicts = given.one("iri"), given.flag("conflicts")
    # a strong tag, which the If-Match of an edit can name
    state = State(serving.semantic_map.sequence, "json" if media_type == JSON else "")
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
    named, prop = _word(content, "thing"), _word(content, "property")
    value = _value(content["value"])

    def write() -> tuple[ChangeSet | None, Assertion]:
        semantic_map = serving.semantic_map
        with semantic_map.hold():
            check_preconditions(request, State(semantic_map.sequence), exists=True)
            thing = semantic_map.assertions.full(named)
            change = semantic_map.assertions.add(thing, prop, value, by=by)
            assertions = {a.property: a for a in semantic_map.assertions.all(thing)}
            return change, assertions[kept_property(prop, thing)]

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

    def retract() -> ChangeSet | None:
        semantic_map = serving.semantic_map
        with semantic_map.hold():
            check_preconditions(request, State(semantic_map.sequence), exists=True)
            return semantic_map.assertions.retract(iri, prop, by=by)

    return written(serving, await serving.write(request, retract), request)


def _word(content: Mapping[str, Any], name: str) -> str:
    value = content[name]
    if not isinstance(value, str) or not value.strip():
        raise Problem(400, f"{name!r} must be a text, got {str(value)[:100]!r}")
    return value.strip()


def _value(value: object) -> object:
    """A text or a list; Problem 400 for another value."""
    if isinstance(value, list) or (isinstance(value, str) and is_unicode(value)):
        return value
    raise Problem(400, f"'value' must be a text, or [x, y, z] in metres, got {str(value)[:100]!r}")
