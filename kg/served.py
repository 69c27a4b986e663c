"""A running `hereabouts serve`, asked for what plain SPARQL servers do not have: who said what, the
past, and why; and given what a mapper or a robot saw.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, Final, TypeVar

import requests
from pyoxigraph import NamedNode

from kg import errors
from kg import vocabulary as v
from kg.assertions import is_unicode
from kg.commits import Cause, ChangeSet
from kg.endpoint import ANSWER_WITHIN, CONNECT_WITHIN, TOKEN_VARIABLE, is_local, without_secrets
from kg.errors import (
    ConflictError,
    HereaboutsError,
    QueryParameterError,
    QueryTooLargeError,
    RemoteError,
    UnreachableError,
)
from kg.history.past import Difference
from kg.history.telling import Entry
from kg.history.why import Reason
from kg.records import Assertion, MapUpdate
from kg.remote import RemoteEngine
from kg.store import MapStore
from kg.update_wire import update_to_json
from kg.wire import (
    Json,
    assertion_of,
    cause_to_json,
    change_of,
    difference_of,
    entry_of,
    reason_of,
    understood,
)

_JSON: Final = "application/json"
_UPDATE: Final = "application/sparql-update"
_CHUNK: Final = 1 << 16
_N_TRIPLES: Final = "application/n-triples"
#: has an answer to a write hold the change set (RFC 7240)
_WHOLE: Final = {"Prefer": "return=representation"}
T = TypeVar("T")


class Served:
    """The server at `root`; writes with the token in the environment. Raises RemoteError.

    What the server refuses comes as the error it is there: HistoryError, InvalidFactError, ...
    """

    def __init__(self, root: str) -> None:
        self.root = root.rstrip("/")
        self.where = without_secrets(root)

    @classmethod
    def at(cls, root: str) -> Served | None:
        """The server whose paths lie under `root`; None where another kind of server answers."""
        served = cls(root)
        try:
            told = served._ask("GET", "health")
        except HereaboutsError:
            told = None
        if isinstance(told, dict) and {"base", "sequence"} <= told.keys():
            return served
        return None

    @property
    def sequence(self) -> int:
        """The number of the map's last transaction."""
        return self._told(_sequence, "GET", "health")

    def assertions(self, iri: str | None) -> tuple[Assertion, ...]:
        """What people said, of one thing or of all."""
        return self._told(_assertions, "GET", "assertions", {} if iri is None else {"iri": iri})

    def assert_(self, iri: str, prop: str, value: object) -> ChangeSet | None:
        """Have something be as said; who says so is the holder of the token."""
        given = value if isinstance(value, str) else _plain(value)
        body = json.dumps({"thing": iri, "property": prop, "value": given})
        headers = {"Content-Type": _JSON, **_WHOLE}
        return self._told(_change, "POST", "assertions", data=body, headers=headers)

    def retract(self, iri: str, prop: str) -> ChangeSet | None:
        """Take back what was said."""
        params = {"iri": iri, "property": prop}
        return self._told(_change, "DELETE", "assertions", params, headers=_WHOLE)

    def update(self, sparql: str) -> ChangeSet | None:
        """Carry out a SPARQL update."""
        headers = {"Content-Type": _UPDATE, **_WHOLE}
        return self._told(_change, "POST", "sparql", data=sparql, headers=headers)

    def write(
        self, update: MapUpdate, cause: Cause, *, seen: int, own: Collection[int]
    ) -> ChangeSet | None:
        """Have records be applied in one transaction; returns once it is sure to stay.

        The writer has heard of the transactions up to `seen`, and made those of `own` itself.
        Raises ConflictError where others changed since then what is to be written.
        """
        told = {
            "update": update_to_json(update),
            "cause": cause_to_json(cause),
            "seen": seen,
            "own": sorted(own),
        }
        return self._posted(_change, "records", told)

    def new_object_iri(self) -> str:
        """The IRI of an object that is yet to be written; nobody else gets the same."""
        return self._posted(_iri, "numbers", {})

    def learn(self, labels: Collection[str], kind: str, model: str) -> dict[str, str]:
        """A category for each label of a network, made where there is none: its IRI."""
        told = {"labels": list(labels), "kind": kind, "model": model}
        return self._posted(_categories, "labels", told)

    def changes(self, since: int) -> Iterator[ChangeSet]:
        """Change sets numbered above `since` up to now, in order, asked for page by page.

        Raises HistoryError where the server does not keep them.
        """
        more = True
        while more:
            found, more = self._told(_page, "GET", "changes", {"since": str(since)})
            yield from found
            since = found[-1].sequence if found else since
            more = more and bool(found)

    def _posted(self, read: Callable[[Any], T], path: str, told: Json) -> T:
        body, headers = json.dumps(told, ensure_ascii=False), {"Content-Type": _JSON, **_WHOLE}
        return self._told(read, "POST", path, data=body, headers=headers)

    def take_ontology(self, triples: bytes, read: Callable[[Json], T], *, whole: bool) -> T:
        """Have N-Triples be the ontology; what `read` makes of what the server tells of it."""
        path = f"graphs/{v.ONTOLOGY_GRAPH.removeprefix(v.GRAPH)}"
        params, headers = {"whole": "true"} if whole else {}, {"Content-Type": _N_TRIPLES}
        return self._told(read, "PUT", path, params, data=triples, headers=headers)

    def sequence_at(self, when: str) -> int:
        """The number of the last transaction at or before a moment."""
        return self._told(_after, "GET", "diff", {"from": when, "to": when})

    def log(self, iri: str) -> tuple[Entry, ...]:
        """Each transaction that changed one thing."""
        return self._told(_entries, "GET", "log", {"iri": iri})

    def diff(self, before: str, after: str) -> Difference:
        """What the map says at one moment and not at another."""
        return self._told(difference_of, "GET", "diff", {"from": before, "to": after})

    def why(self, what: str) -> tuple[Reason, ...]:
        """Why the map says so, of a thing or of a fact."""
        return self._told(_reasons, "GET", "why", {"what": what})

    def fetch(
        self,
        path: str,
        params: Sequence[tuple[str, str]],
        media_type: str,
        *,
        seconds: float,
        most: int,
    ) -> tuple[str, bytes]:
        """Media type and body of what a path answers, as it comes.

        Raises QueryTooLargeError beyond `most` bytes, and what the server refuses.
        """
        accept = {"Accept": f"{media_type}, application/problem+json;q=0.1"}
        with self._sent("GET", path, params, accept, b"", seconds) as reply:
            body = bytearray()
            for chunk in reply.iter_content(_CHUNK):
                body += chunk
                if len(body) > most:
                    raise QueryTooLargeError(f"{self.where} has more than {most} bytes to say")
            if not reply.ok:
                try:
                    told = json.loads(body)
                except ValueError:
                    told = {"detail": " ".join(body[:500].decode("utf-8", "replace").split())}
                raise _refusal(self.where, reply.status_code, told)
            return reply.headers.get("content-type", "").split(";")[0], bytes(body)

    def _told(self, read: Callable[[Any], T], *asked: Any, **body: Any) -> T:
        """What `read` makes of the answer; RemoteError where it is none of ours."""
        return understood(self.where, read, self._ask(*asked, **body))

    def _ask(
        self,
        method: str,
        path: str,
        params: dict[str, str] | None = None,
        *,
        headers: dict[str, str] | None = None,
        data: str | bytes = b"",
    ) -> Any:
        _refuse_surrogates(data, *(params or {}).values())
        given = {"Accept": _JSON, **(headers or {})}
        if (token := os.environ.get(TOKEN_VARIABLE)) and method != "GET":
            given["Authorization"] = f"Bearer {token}"
        body = data.encode() if isinstance(data, str) else data
        with self._sent(
            method, path, tuple((params or {}).items()), given, body, ANSWER_WITHIN
        ) as reply:
            try:
                told = reply.json()
            except ValueError as error:
                status = reply.status_code
                raise RemoteError(f"{self.where} answered no JSON, with status {status}") from error
        if not reply.ok:
            raise _refusal(self.where, reply.status_code, told)
        return told

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
        """The reply, to be read within the block; UnreachableError where it breaks off."""
        try:
            with requests.Session() as session:
                # a proxy would look for the server on itself
                session.trust_env = not is_local(self.root)
                with session.request(
                    method,
                    f"{self.root}/{path}",
                    params=list(params),
                    headers=headers,
                    timeout=(min(CONNECT_WITHIN, seconds), seconds),
                    data=body,
                    stream=True,
                ) as reply:
                    yield reply
        except requests.RequestException as error:
            reason = type(error).__name__
            raise UnreachableError(f"{self.where} does not answer ({reason})") from error


def served_at(store: MapStore) -> Served | None:
    """The running `hereabouts serve` behind a store on a server; None where it is no such."""
    engine = store.engine
    if not isinstance(engine, RemoteEngine) or not engine.query_url.endswith("/sparql"):
        return None
    return Served.at(engine.query_url.removesuffix("/sparql"))


def _plain(value: object) -> object:
    """A position as numbers, whatever holds them; anything else as text."""
    try:
        return [float(number) for number in value]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        return str(value)


def _refuse_surrogates(*texts: str | bytes) -> None:
    for text in texts:
        if isinstance(text, str) and not is_unicode(text):
            raise QueryParameterError(f"{text[:100]!r} is no Unicode text")


def _sequence(told: Json) -> int:
    return int(told["sequence"])


def _after(told: Json) -> int:
    return int(told["after"])


def _assertions(told: Json) -> tuple[Assertion, ...]:
    return tuple(map(assertion_of, told["assertions"]))


def _entries(told: list[Json]) -> tuple[Entry, ...]:
    return tuple(map(entry_of, told))


def _reasons(told: list[Json]) -> tuple[Reason, ...]:
    return tuple(map(reason_of, told))


def _iri(told: Json) -> str:
    return NamedNode(told["iri"]).value


def _categories(told: Json) -> dict[str, str]:
    return {str(label): NamedNode(iri).value for label, iri in told["categories"].items()}


def _page(told: Json) -> tuple[tuple[ChangeSet, ...], bool]:
    return tuple(map(change_of, told["changes"])), told["more"] is True


def _change(told: Json) -> ChangeSet | None:
    return None if told["change"] is None else change_of(told["change"])


def _refusal(where: str, status: int, told: Any) -> HereaboutsError:
    """The error that the server met, where it says which."""
    told = told if isinstance(told, dict) else {}
    detail = str(told.get("detail", f"it answered {status}"))
    kind = getattr(errors, str(told.get("error", "")), None)
    if kind is ConflictError:
        return ConflictError(detail, map(str, told.get("things", ())))
    if isinstance(kind, type) and issubclass(kind, HereaboutsError):
        return kind(detail)
    hint = f"; one of its tokens goes into {TOKEN_VARIABLE}" if status == 401 else ""
    return RemoteError(f"{where} refused ({status}): {detail}{hint}")
