"""HTTP client of a running `hereabouts serve`: requests that a plain SPARQL server does not have.

Assertions, history and explanations are read; records, updates and ontologies are written.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, TypeVar
from urllib.parse import quote

import requests

from kg.maps.facts.assertions import is_unicode
from kg.maps.object_pictures import MAX_BYTES
from kg.maps.surface.voxels import MEDIA_TYPE, Surface, decoded
from kg.model import errors
from kg.model import vocabulary as v
from kg.model.errors import (
    ConflictError,
    HereaboutsError,
    NotAllowedError,
    QueryParameterError,
    QueryTooLargeError,
    RemoteError,
    UnreachableError,
)
from kg.model.transactions import ChangeSet
from kg.serving.client.record_codec import (
    Json,
    change_from_json,
    decoded_reply,
)
from kg.store.credentials import HINT
from kg.store.http_session import HttpSession
from kg.store.sparql_client import (
    ANSWER_WITHIN,
    CONFIRM,
    CONFIRMED,
    without_secrets,
)

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

    Methods raise RemoteError, and for a refusal the error that the server names. Those that write
    first call `check_writable`.
    """

    def __init__(self, root: str) -> None:
        self.root = root.rstrip("/")
        self.where = without_secrets(root)
        self._http = HttpSession(root)
        self.check_writable: Callable[[], None] = lambda: None

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

    def get(self, decode: Callable[[Any], T], path: str, **params: str) -> T:
        """The reply to a GET request, as `decode` reads its JSON."""
        return self._decoded(decode, "GET", path, params)

    def post(
        self, decode: Callable[[Any], T], path: str, content: Json, *, confirmed: bool = False
    ) -> T:
        """The reply to JSON, by the holder of the token; a large deletion has to be `confirmed`."""
        self.check_writable()
        headers = {"Content-Type": _JSON, **_WHOLE, **_confirmation(confirmed)}
        body = json.dumps(content, ensure_ascii=False)
        return self._decoded(decode, "POST", path, data=body, headers=headers)

    def delete(self, path: str, **params: str) -> ChangeSet | None:
        """The transaction of a DELETE request."""
        self.check_writable()
        return self._decoded(change_of_reply, "DELETE", path, params, headers=_WHOLE)

    def update(self, sparql: str, *, confirmed: bool = False) -> ChangeSet | None:
        """Apply a SPARQL update; a large deletion has to be `confirmed`."""
        self.check_writable()
        headers = {"Content-Type": _UPDATE, **_WHOLE, **_confirmation(confirmed)}
        return self._decoded(change_of_reply, "POST", "sparql", data=sparql, headers=headers)

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
                raise _refusal(self.where, reply.status_code, bytes(body))
            return reply.headers.get("content-type", "").split(";")[0], bytes(body)

    def picture(self, number: str) -> bytes | None:
        """The picture of an object by its number; None without one."""
        path, most = f"pictures/{quote(number, safe='')}", MAX_BYTES
        _, body = self.fetch(path, (), "image/jpeg", seconds=ANSWER_WITHIN, max_bytes=most)
        return body or None

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
            answered = reply.content
        if not reply.ok:
            raise _refusal(self.where, reply.status_code, answered)
        try:
            return json.loads(answered)
        except (ValueError, RecursionError) as error:
            raise RemoteError(f"{self.where} sent a reply that is not JSON") from error

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


def _confirmation(confirmed: bool) -> dict[str, str]:
    return {CONFIRM: CONFIRMED} if confirmed else {}


def _check_unicode(*texts: str | bytes) -> None:
    for text in texts:
        if isinstance(text, str) and not is_unicode(text):
            raise QueryParameterError(f"{text[:100]!r} is no Unicode text")


def _page(data: Json) -> tuple[tuple[ChangeSet, ...], bool]:
    return tuple(map(change_from_json, data["changes"])), data["more"] is True


def change_of_reply(data: Json) -> ChangeSet | None:
    """The transaction in a reply; None if nothing changed."""
    return None if data["change"] is None else change_from_json(data["change"])


def _refusal(where: str, status: int, body: bytes) -> HereaboutsError:
    """The error in a refusal, or RemoteError."""
    try:
        data = json.loads(body)
    except (ValueError, RecursionError):
        data = {"detail": " ".join(body[:500].decode("utf-8", "replace").split())}
    data = data if isinstance(data, dict) else {}
    detail = str(data.get("detail", f"it answered {status}"))
    kind = getattr(errors, str(data.get("error", "")), None)
    if kind is ConflictError:
        return ConflictError(detail, map(str, data.get("things", ())))
    if isinstance(kind, type) and issubclass(kind, HereaboutsError):
        return kind(detail)
    hint = f"; {HINT}" if status == 401 else ""
    refused = NotAllowedError if status in (401, 403) else RemoteError
    return refused(f"{where} refused ({status}): {detail}{hint}")
