"""`/records`, `/numbers`, `/labels`: writes of remote mappers and robots.

A POST to `/records` is one transaction of a frame or of a look. The response is sent once the
transaction is in the history, so an acknowledged write survives a crash of client or server.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from kg.maps.conflict_check import apply_remote_update
from kg.maps.facts.assertions import is_unicode
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.update_codec import MAX_WHOLE, update_from_json
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import written
from kg.serving.server.http.bodies import json_response, read_json
from kg.serving.server.http.client_departure import completed
from kg.serving.server.http.client_sessions import asker_of
from kg.serving.server.http.problems import Problem

#: kinds of causes: frames of a mapper, a search of a robot, an import
_KINDS: Final = ("frame", "search", "import")
_MAX_TEXT: Final = 500  # characters of a note, a label, the name of a network
#: a search, which is the author of its transactions
_SEARCH: Final = re.compile(r"search/[0-9]{1,15}")
_MAX_ITEMS: Final = 10_000  # labels, or own transactions, of one request


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

    return written(serving, await completed(apply), request)


async def numbers(serving: AppState, request: Request) -> Response:
    """Reserve the IRI of a new object."""
    serving.author_of(request)
    await read_json(request, serving.settings.limits, ())
    return json_response({"iri": await completed(serving.semantic_map.new_object_iri)})


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
    found = await completed(learn)
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
