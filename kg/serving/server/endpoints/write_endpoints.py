"""Writes of remote mappers and robots (`/records`, `/numbers`, `/labels`), and of people.

People edit rooms (`POST /rooms`) and restore a past state (`POST /restore`).

A POST to `/records` is one transaction of a frame or of a look. The response is sent once the
transaction is in the history, so an acknowledged write survives a crash of client or server.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import asdict
from functools import partial
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from kg.maps.conflict_check import apply_remote_update
from kg.maps.facts.assertions import is_unicode
from kg.model.room_edit import RoomEdit
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.update_codec import MAX_WHOLE, update_from_json
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import written
from kg.serving.server.http.bodies import json_response, read_json
from kg.serving.server.http.clients import asker_of
from kg.serving.server.http.conditions import sequence_at
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.request_checks import is_confirmed
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
    serving.sessions.saw(asker_of(request).client, serving.semantic_map.sequence)
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
    serving.sessions.saw(asker_of(request).client, sequence)
    return json_response(asdict(done), {SEQUENCE: str(sequence)})


def _scopes(given: Any) -> Collection[str]:
    is_list = isinstance(given, list) and len(given) <= _MAX_THINGS
    if not is_list or not all(isinstance(name, str) for name in given):
        raise Problem(
            400, f"'only' must be a list of up to {_MAX_THINGS} texts, as in [\"object/17\"]"
        )
    return tuple(given)
