"""HTTP client of a running `hereabouts serve`: requests that a plain SPARQL server does not have.

Assertions, history and explanations are read; records, updates and ontologies are written.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict
from typing import Any, Final, TypeVar

import requests
from pyoxigraph import NamedNode

from kg.history.replay.point_in_time import Difference
from kg.history.reports.comparison import Comparison
from kg.history.reports.events import HistoryEvent
from kg.history.reports.explanation import Explanation
from kg.maps.facts.assertions import is_unicode
from kg.maps.surface.voxels import Surface
from kg.maps.surface.wire_format import MEDIA_TYPE, decoded
from kg.maps.update.restoration import Restored
from kg.model import errors
from kg.model import vocabulary as v
from kg.model.errors import (
    ConflictError,
    HereaboutsError,
    QueryParameterError,
    QueryTooLargeError,
    RemoteError,
    UnreachableError,
)
from kg.model.records import Assertion, MapUpdate
from kg.model.room_edit import RoomEdit
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.record_codec import (
    Json,
    assertion_from_json,
    cause_to_json,
    change_from_json,
    comparison_from_json,
    decoded_reply,
    difference_from_json,
    entry_from_json,
    reason_from_json,
    restored_from_json,
)
from kg.serving.client.update_codec import update_to_json
from kg.store.credentials import HINT
from kg.store.http_session import HttpSession
from kg.store.sparql_backend import SparqlBackend
from kg.store.sparql_client import (
    ANSWER_WITHIN,
    CONFIRM,
    CONFIRMED,
    without_secrets,
)
from kg.store.transactional import TransactionalStore

_JSON: Final = "application/json"
_UPDATE: Final = "application/sparql-update"
_CHUNK: Final = 1 << 16
_SURFACE_SECONDS: Final = 60.0  # [s] to wait for a surface
_SURFACE_BYTES: Final = 1 << 24  # of a surface
_N_TRIPLES: Final = "application/n-triples"
#: requests the change set in the response to a write (RFC 7240)
_WHOLE: Final = {"Prefer": "return=representation"}
T = TypeVar("T")


class ServedClient:
    """Client of the server at `root`; writes with the token in the environment.

    Methods raise RemoteError, and for a refusal the error that the server names.
    """

    def __init__(self, root: str) -> None:
        self.root = root.rstrip("/")
        self.where = without_secrets(root)
        self._http = HttpSession(root)

    @classmethod
    def at(cls, root: str) -> ServedClient | None:
        """The client of the `hereabouts serve` at `root`; None if another server answers."""
        served = cls(root)
        try:
            content = served._request("GET", "health")
        except HereaboutsError:
            content = None
        if isinstance(content, dict) and {"base", "sequence"} <= content.keys():
            return served
        served.close()
        return None

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    @property
    def sequence(self) -> int:
        """The number of the map's last transaction."""
        return self._decoded(lambda data: int(data["sequence"]), "GET", "health")

    def assertions(self, iri: str | None) -> tuple[Assertion, ...]:
        """Assertions, of one thing or of all."""
        return self._decoded(
            lambda data: tuple(map(assertion_from_json, data["assertions"])),
            "GET",
            "assertions",
            {} if iri is None else {"iri": iri},
        )

    def assert_(self, iri: str, prop: str, value: object) -> ChangeSet | None:
        """Assert a property, by the holder of the token."""
        given = value if isinstance(value, str) else _plain(value)
        body = json.dumps({"thing": iri, "property": prop, "value": given})
        headers = {"Content-Type": _JSON, **_WHOLE}
        return self._decoded(_change, "POST", "assertions", data=body, headers=headers)

    def retract(self, iri: str, prop: str) -> ChangeSet | None:
        """Retract an assertion."""
        params = {"iri": iri, "property": prop}
        return self._decoded(_change, "DELETE", "assertions", params, headers=_WHOLE)

    def edit_rooms(self, edit: RoomEdit) -> ChangeSet | None:
        """Apply an edit of rooms, by the holder of the token."""
        headers = {"Content-Type": _JSON, **_WHOLE}
        return self._decoded(
            _change, "POST", "rooms", data=json.dumps(asdict(edit)), headers=headers
        )

    def update(self, sparql: str, *, confirmed: bool = False) -> ChangeSet | None:
        """Apply a SPARQL update; a large deletion has to be `confirmed`."""
        headers = {"Content-Type": _UPDATE, **_WHOLE, **_confirmation(confirmed)}
        return self._decoded(_change, "POST", "sparql", data=sparql, headers=headers)

    def restore(
        self, when: str, only: Collection[str], *, confirmed: bool, dry_run: bool
    ) -> Restored:
        """Restore a past state; returns counts of the changes."""
        body = json.dumps({"to": when, "only": list(only), "dry_run": dry_run})
        headers = {"Content-Type": _JSON, **_confirmation(confirmed)}
        return self._decoded(restored_from_json, "POST", "restore", data=body, headers=headers)

    def write(
        self, update: MapUpdate, cause: Cause, *, known_sequence: int, own: Collection[int]
    ) -> ChangeSet | None:
        """Apply records in one transaction; returns once it is durable.

        The writer has read the transactions up to `known_sequence`, and made those in `own`.
        Raises ConflictError if others have changed the same things since.
        """
        body = {
            "update": update_to_json(update),
            "cause": cause_to_json(cause),
            "seen": known_sequence,
            "own": sorted(own),
        }
        return self._post(_change, "records", body)

    def new_object_iri(self) -> str:
        """A new object IRI, reserved for the caller."""
        return self._post(lambda data: NamedNode(data["iri"]).value, "numbers", {})

    def learn(self, labels: Collection[str], kind: str, model: str) -> dict[str, str]:
        """The IRI of a category for each label of a network; missing ones are added."""
        body = {"labels": list(labels), "kind": kind, "model": model}
        return self._post(_categories, "labels", body)

    def changes(self, since: int) -> Iterator[ChangeSet]:
        """Change sets numbered above `since` up to now, in order, requested page by page.

        Raises HistoryError if the server does not keep them.
        """
        more = True
        while more:
            found, more = self._decoded(_page, "GET", "changes", {"since": str(since)})
            yield from found
            since = found[-1].sequence if found else since
            more = more and bool(found)

    def _post(self, decode: Callable[[Any], T], path: str, content: Json) -> T:
        body, headers = json.dumps(content, ensure_ascii=False), {"Content-Type": _JSON, **_WHOLE}
        return self._decoded(decode, "POST", path, data=body, headers=headers)

    def take_ontology(self, triples: bytes, decode: Callable[[Json], T], *, whole: bool) -> T:
        """Replace the ontology by N-Triples; returns the reply as `decode` reads it."""
        path = f"graphs/{v.ONTOLOGY_GRAPH.value.removeprefix(v.GRAPH)}"
        params, headers = {"whole": "true"} if whole else {}, {"Content-Type": _N_TRIPLES}
        return self._decoded(decode, "PUT", path, params, data=triples, headers=headers)

    def sequence_at(self, when: str) -> int:
        """The number of the last transaction at or before a moment."""
        return self._decoded(
            lambda data: int(data["after"]), "GET", "diff", {"from": when, "to": when, "facts": "1"}
        )

    def log(self, iri: str) -> tuple[HistoryEvent, ...]:
        """The history events of one thing."""
        return self._decoded(
            lambda data: tuple(map(entry_from_json, data)), "GET", "log", {"iri": iri}
        )

    def diff(self, before: str, after: str) -> Difference:
        """The difference between the states at two moments."""
        params = {"from": before, "to": after, "facts": "1"}
        return self._decoded(difference_from_json, "GET", "diff", params)

    def compare(self, before: str, after: str | None, far: float) -> Comparison:
        """The changes of objects between two moments."""
        params = {"from": before, "far": f"{far:g}"} | ({} if after is None else {"to": after})
        return self._decoded(comparison_from_json, "GET", "diff", params)

    def why(self, what: str) -> tuple[Explanation, ...]:
        """The explanation of a thing or of a fact."""
        return self._decoded(
            lambda data: tuple(map(reason_from_json, data)), "GET", "why", {"what": what}
        )

    def surface(self, sequence: int | None, min_count: int) -> Surface:
        """The surface at a transaction, or now; a large one in larger voxels."""
        params = [("count", str(min(min_count, 999)))]
        params += [] if sequence is None else [("at", str(sequence))]
        _, body = self.fetch(
            "surface", params, MEDIA_TYPE, seconds=_SURFACE_SECONDS, max_bytes=_SURFACE_BYTES
        )
        try:
            return decoded(body)
        except (ValueError, KeyError, TypeError) as error:
            raise RemoteError(f"{self.where} sent no surface: {error}") from error

    def fetch(
        self,
        path: str,
        params: Sequence[tuple[str, str]],
        media_type: str,
        *,
        seconds: float,
        max_bytes: int,
    ) -> tuple[str, bytes]:
        """Media type and body of the reply to a GET request.

        Raises QueryTooLargeError beyond `max_bytes`, and the error of a refusal.
        """
        accept = {"Accept": f"{media_type}, application/problem+json;q=0.1"}
        with self._sent("GET", path, params, accept, b"", seconds) as reply:
            body = bytearray()
            for chunk in reply.iter_content(_CHUNK):
                body += chunk
                if len(body) > max_bytes:
                    raise QueryTooLargeError(f"{self.where} sent more than {max_bytes} bytes")
            if not reply.ok:
                try:
                    content = json.loads(body)
                except (ValueError, RecursionError):
                    content = {"detail": " ".join(body[:500].decode("utf-8", "replace").split())}
                raise _refusal(self.where, reply.status_code, content)
            return reply.headers.get("content-type", "").split(";")[0], bytes(body)

    def _decoded(self, decode: Callable[[Any], T], *request: Any, **body: Any) -> T:
        """Sends a request and decodes its JSON reply."""
        return decoded_reply(self.where, decode, self._request(*request, **body))

    def _request(
        self,
        method: str,
        path: str,
        params: dict[str, str] | None = None,
        *,
        headers: dict[str, str] | None = None,
        data: str | bytes = b"",
    ) -> Any:
        _check_unicode(data, *(params or {}).values())
        given = {"Accept": _JSON, **(headers or {})}
        body = data.encode() if isinstance(data, str) else data
        with self._sent(
            method, path, tuple((params or {}).items()), given, body, ANSWER_WITHIN
        ) as reply:
            try:
                content = reply.json()
            except (ValueError, RecursionError) as error:
                status = reply.status_code
                raise RemoteError(
                    f"{self.where} sent a reply that is not JSON, with status {status}"
                ) from error
        if not reply.ok:
            raise _refusal(self.where, reply.status_code, content)
        return content

    @contextlib.contextmanager
    def _sent(
        self,
        method: str,
        path: str,
        params: Sequence[tuple[str, str]],
        headers: dict[str, str],
        body: bytes,
        seconds: float,
    ) -> Iterator[requests.Response]:
        """The reply, to be read within the block; UnreachableError if the connection breaks."""
        try:
            with self._http.send(
                method,
                f"{self.root}/{path}",
                headers=headers,
                seconds=seconds,
                safe=method == "GET",
                params=list(params),
                data=body,
                stream=True,
            ) as reply:
                yield reply
        except requests.RequestException as error:
            reason = type(error).__name__
            raise UnreachableError(f"{self.where} does not answer ({reason})") from error


def served_at(store: TransactionalStore) -> ServedClient | None:
    """The client of the `hereabouts serve` behind a store; None if it is another server."""
    engine = store.engine
    if not isinstance(engine, SparqlBackend) or not engine.query_url.endswith("/sparql"):
        return None
    return ServedClient.at(engine.query_url.removesuffix("/sparql"))


def _confirmation(confirmed: bool) -> dict[str, str]:
    return {CONFIRM: CONFIRMED} if confirmed else {}


def _plain(value: object) -> object:
    """A position of any sequence type as a list of numbers; anything else as text."""
    try:
        return [float(number) for number in value]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        return str(value)


def _check_unicode(*texts: str | bytes) -> None:
    for text in texts:
        if isinstance(text, str) and not is_unicode(text):
            raise QueryParameterError(f"{text[:100]!r} is no Unicode text")


def _categories(data: Json) -> dict[str, str]:
    return {str(label): NamedNode(iri).value for label, iri in data["categories"].items()}


def _page(data: Json) -> tuple[tuple[ChangeSet, ...], bool]:
    return tuple(map(change_from_json, data["changes"])), data["more"] is True


def _change(data: Json) -> ChangeSet | None:
    return None if data["change"] is None else change_from_json(data["change"])


def _refusal(where: str, status: int, data: Any) -> HereaboutsError:
    """The error in a refusal, or RemoteError."""
    data = data if isinstance(data, dict) else {}
    detail = str(data.get("detail", f"it answered {status}"))
    kind = getattr(errors, str(data.get("error", "")), None)
    if kind is ConflictError:
        return ConflictError(detail, map(str, data.get("things", ())))
    if isinstance(kind, type) and issubclass(kind, HereaboutsError):
        return kind(detail)
    hint = f"; {HINT}" if status == 401 else ""
    return RemoteError(f"{where} refused ({status}): {detail}{hint}")
