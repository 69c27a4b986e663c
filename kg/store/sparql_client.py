"""Client of one SPARQL 1.1 server: finds its query and update addresses, sends requests.

At its time limit an Oxigraph server breaks off the body of a reply with status 200. So every body
is parsed to its end, and a truncated one is an error.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit, urlunsplit

from pyoxigraph import (
    QueryBoolean,
    QueryResultsFormat,
    QuerySolution,
    RdfFormat,
    Triple,
    Variable,
    parse,
    parse_query_results,
)

from kg.model.errors import (
    HistoryError,
    NotAllowedError,
    QueryTimeoutError,
    QueryTooLargeError,
    RemoteError,
    UnreachableError,
)
from kg.store.credentials import HINT
from kg.store.virtuoso import complaint, gives_triples, is_virtuoso, plain, readable

if TYPE_CHECKING:
    import requests  # imported by requests only: maps in folders do not need it

#: header of an answer: its transaction; of a query: the oldest transaction it accepts
SEQUENCE: Final = "Here-Sequence"
CONFIRM: Final = "Here-Confirm"  # header of a request that may delete a large share of the map
CONFIRMED: Final = "delete"  # the value of that header
UPDATE_VARIABLE: Final = "HEREABOUTS_UPDATE_URL"
ANSWER_WITHIN = 300.0  # [s]
_CHUNK = 1 << 16

_RESULTS = "application/sparql-results+json"
_TRIPLES = "application/n-triples"
#: (query path, update path), relative to the address
_LAYOUTS: Final[tuple[tuple[str, str], ...]] = (
    ("/query", "/update"),  # Oxigraph, Fuseki
    ("", "/statements"),  # RDF4J, GraphDB: .../repositories/NAME
    ("/sparql", "/sparql"),  # hereabouts serve, Virtuoso
    ("", ""),  # the address is the endpoint itself
)


@dataclass(frozen=True, slots=True)
class Solutions:
    """A whole answer of SELECT."""

    variables: tuple[Variable, ...]
    rows: tuple[QuerySolution, ...]

    def __iter__(self) -> Iterator[QuerySolution]:
        return iter(self.rows)


@dataclass(frozen=True, slots=True)
class Triples:
    """A whole answer of CONSTRUCT or DESCRIBE."""

    triples: tuple[Triple, ...]

    def __iter__(self) -> Iterator[Triple]:
        return iter(self.triples)


Answer = Solutions | QueryBoolean | Triples


class SparqlClient:
    """Client of a SPARQL server; `at` creates it. Safe to use from several threads."""

    def __init__(
        self,
        address: str,
        query_url: str,
        update_url: str,
        always: Sequence[tuple[str, str]] = (),
        token: str | None = None,
    ) -> None:
        self.where = without_secrets(address)
        self.query_url = query_url
        self.update_url = update_url
        self._always = tuple(always)  # parameters of each query
        self.virtuoso = False  # until the first answer
        self.min_sequence = 0  # oldest transaction accepted in answers of a `hereabouts serve`
        from kg.store.http_session import HttpSession

        self._http = HttpSession(query_url, token)

    @classmethod
    def at(
        cls, address: str, always: Sequence[tuple[str, str]] = (), *, token: str | None = None
    ) -> SparqlClient:
        """Client of the server at `address`; finds the query and update addresses by trying.

        Args:
            address: address of the server, the repository or the endpoint. The environment variable
                HEREABOUTS_UPDATE_URL overrides the address of updates.
            always: parameters of every query.
            token: bearer token of every request; None: the token in the environment.

        Raises:
            RemoteError: no server answers, or it does not support SPARQL.
        """
        root = address.rstrip("/")
        detail = ""
        for query, update in _LAYOUTS:
            if update == "/statements" and "/repositories/" not in root:
                continue
            updates = os.environ.get(UPDATE_VARIABLE) or root + update
            endpoint = cls(address, root + query, updates, always, token)
            try:
                if isinstance(endpoint.ask("ASK {}"), QueryBoolean):
                    return endpoint
            except UnreachableError:
                endpoint.close()
                raise
            except (RemoteError, SyntaxError) as error:
                detail = detail or str(error)
            endpoint.close()
        raise RemoteError(
            f"{without_secrets(address)} does not speak SPARQL at /query, /sparql or itself"
            f" ({detail}); give the address of a SPARQL 1.1 server"
        )

    def ask(self, query: str, parameters: Sequence[tuple[str, str]] = ()) -> Answer:
        """The whole answer to a query.

        Raises:
            SyntaxError: the query does not parse on the server; with the server's message.
            RemoteError: any other failure, a truncated answer included.
        """
        form = [("query", query), *self._always, *parameters]
        reply = self._post(self.query_url, form, self._accept(query))
        self.virtuoso = is_virtuoso(reply.headers.get("server"))
        kind = reply.headers.get("content-type", "").split(";")[0].strip()
        try:
            return self._read(reply.content, kind)
        except (SyntaxError, ValueError) as error:
            if kind not in (_RESULTS, _TRIPLES):
                raise RemoteError(
                    f"{self.where} answered with {kind or 'no type'} instead of SPARQL results"
                ) from error
            raise RemoteError(self._cut_short()) from error

    def fetch(
        self, query: str, parameters: Sequence[tuple[str, str]], *, seconds: float, max_bytes: int
    ) -> tuple[str, bytes]:
        """Media type and unparsed body of an answer: JSON results or N-Triples.

        A truncated body is not detected here, but when it is parsed.

        Raises:
            QueryTimeoutError: the answer takes longer than `seconds`.
            QueryTooLargeError: the answer has more than `max_bytes`.
            SyntaxError, RemoteError: as `ask`.
        """
        import requests

        deadline, body = time.monotonic() + seconds, bytearray()
        form = [("query", query), *self._always, *parameters]
        accept = self._accept(query)
        with self._post(self.query_url, form, accept, seconds, stream=True) as reply:
            try:
                for chunk in reply.iter_content(_CHUNK):
                    body += chunk
                    if len(body) > max_bytes:
                        raise QueryTooLargeError(
                            f"the answer of {self.where} has more than {max_bytes} bytes"
                        )
                    if time.monotonic() > deadline:
                        raise QueryTimeoutError(self._too_late(seconds))
            except requests.exceptions.ChunkedEncodingError as error:
                raise RemoteError(self._cut_short()) from error
            except requests.RequestException as error:
                raise QueryTimeoutError(self._too_late(seconds)) from error
            media_type = reply.headers.get("content-type", "").split(";")[0].strip()
        if self.virtuoso and media_type == _RESULTS:
            try:
                return media_type, readable(bytes(body))
            except ValueError as error:
                raise RemoteError(self._cut_short()) from error
        return media_type, bytes(body)

    def update(self, update: str) -> None:
        """Run an update; raises RemoteError if the server did not apply it."""
        try:
            self._post(self.update_url, [("update", update)], _RESULTS, safe=False)
        except SyntaxError as error:
            raise RemoteError(f"{self.where} refused an update: {error}") from error

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def _read(self, body: bytes, kind: str) -> Answer:
        if kind == _TRIPLES:
            found = (quad.triple for quad in parse(body, format=RdfFormat.N_TRIPLES))
            return Triples(tuple(map(plain, found) if self.virtuoso else found))
        body = readable(body) if self.virtuoso else body
        answer = parse_query_results(body, format=QueryResultsFormat.JSON)
        if isinstance(answer, QueryBoolean):
            return answer
        return Solutions(tuple(answer.variables), tuple(answer))

    def _accept(self, query: str) -> str:
        if not self.virtuoso:
            return f"{_RESULTS}, {_TRIPLES}"
        return _TRIPLES if gives_triples(query) else _RESULTS

    def _post(
        self,
        url: str,
        form: Sequence[tuple[str, str]],
        accept: str,
        seconds: float = ANSWER_WITHIN,
        *,
        stream: bool = False,
        safe: bool = True,
    ) -> requests.Response:
        import requests

        # every server accepts a form; Virtuoso 7.2 never replies to a query as the body
        accepted = {SEQUENCE: str(self.min_sequence)} if self.min_sequence else {}
        try:
            reply = self._http.send(
                "POST",
                url,
                headers={"Accept": accept, **accepted},
                seconds=seconds,
                safe=safe,
                data=list(form),
                stream=stream,
            )
        except (requests.ConnectTimeout, requests.exceptions.InvalidURL) as error:
            raise UnreachableError(self._unreachable("no answer in time")) from error
        except requests.exceptions.ChunkedEncodingError as error:
            raise RemoteError(self._cut_short()) from error
        except requests.ReadTimeout as error:
            if stream:
                raise QueryTimeoutError(self._too_late(seconds)) from error
            raise RemoteError(self._too_late(seconds)) from error
        except requests.RequestException as error:
            raise UnreachableError(self._unreachable(_reason(error))) from error
        if not reply.ok:
            self._raise_refusal(reply)
        return reply

    def _raise_refusal(self, reply: requests.Response) -> None:
        problem = _problem(reply)
        text = str(problem.get("detail", reply.text))
        detail = (complaint(text) if self.virtuoso else " ".join(text.split()))[:300]
        if reply.status_code == 400:
            raise SyntaxError(detail)
        if reply.status_code in (401, 403):
            raise NotAllowedError(
                f"{self.where} refused ({reply.status_code}{detail and ': '}{detail}); {HINT}, or "
                "user:password@ into the address"
            )
        if reply.status_code == 404 and problem.get("error") == "HistoryError":
            raise HistoryError(f"{self.where}: {detail}")
        raise RemoteError(f"{self.where} answered {reply.status_code}: {detail or reply.reason}")

    def _unreachable(self, reason: str) -> str:
        return (
            f"no server answers at {self.where} ({reason}); start one there, "
            "e.g. oxigraph serve --location DIR --bind HOST:PORT"
        )

    def _too_late(self, seconds: float) -> str:
        return f"{self.where} gave no answer within {seconds:g} s; ask for less"

    def _cut_short(self) -> str:
        return (
            f"{self.where} broke off its answer, most likely at its time limit; ask for less, "
            "or raise the limit (oxigraph serve --timeout-s)"
        )


def _problem(reply: requests.Response) -> dict[str, object]:
    """Problem details (RFC 9457) of a refused request; empty without them."""
    if "problem+json" not in reply.headers.get("content-type", ""):
        return {}
    try:
        problem = reply.json()
    except ValueError:
        return {}
    return problem if isinstance(problem, dict) else {}


def without_secrets(address: str) -> str:
    """An address without user, password and query, for messages."""
    parts = urlsplit(address)
    host = parts.netloc.rpartition("@")[2]
    return urlunsplit((parts.scheme, host, parts.path, "", "")).rstrip("/")


def _reason(error: Exception) -> str:
    text = str(error)
    match = re.search(r"\[Errno [^\]]+\] ([^\"')]+)|(Name or service not known|resolve)", text)
    return (match[1] or "unknown host") if match else type(error).__name__
