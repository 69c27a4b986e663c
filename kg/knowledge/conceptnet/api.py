"""Client of ConceptNet's web API: paged queries about the categories, rate-limited."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Final
from urllib.parse import urlencode, urljoin, urlsplit

import requests

from kg.knowledge.conceptnet.cache import ResponseCache
from kg.knowledge.conceptnet.dump import DumpStatistics, Progress
from kg.knowledge.conceptnet.edges import Edge, EdgeFilter, MalformedEdgeError
from kg.knowledge.conceptnet.names import TermMatcher
from kg.knowledge.conceptnet.tables5 import parse_edge
from kg.knowledge.conceptnet.throttle import Throttle
from kg.model.errors import ConceptNetError

_PAGE: Final = 1000  # edges; the service's maximum page size
_MAX_PAGES: Final = 101  # offsets end at 100,000
_ATTEMPTS: Final = 5
_MAX_WAIT: Final = 600.0  # [s] upper bound of Retry-After
_MAX_BYTES: Final = 64 << 20  # bytes of an answer
_TIMEOUT: Final = (10.0, 60.0)  # [s] to connect, and between bytes
_FILES: Final = (
    "the public service is often down: import a file instead, the assertions of "
    "github.com/commonsense/conceptnet5/wiki/Downloads (--from FILE)"
)
#: (relation, end of the edge that is the object's term)
_OF_OBJECTS: Final = (
    *(("AtLocation", "start"), ("PartOf", "start"), ("IsA", "start")),
    *(("HasA", "end"), ("LocatedNear", "node"), ("Synonym", "node")),
)


@dataclass(slots=True)
class ApiClient:
    """HTTP client of one service, with rate limits, retries and a cache of responses."""

    address: str
    cache: ResponseCache | None = None
    throttle: Throttle = field(default_factory=Throttle)
    sleep: Callable[[float], None] = time.sleep
    statistics: DumpStatistics = field(default_factory=DumpStatistics)
    _session: requests.Session = field(default_factory=requests.Session)

    def __post_init__(self) -> None:
        parts = urlsplit(self.address)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ConceptNetError(f"{self.address!r} is no http(s) address and no file")
        self.address = self.address.rstrip("/") + "/"
        self._session.headers.update({"Accept": "application/json"})

    def close(self) -> None:
        """Close the connection."""
        self._session.close()

    def edges(self, **parameters: str) -> Iterator[object]:
        """All edges of a query (start, end, node, rel), over all its pages.

        Raises:
            ConceptNetError: the service fails, refuses, or sends an invalid response.
        """
        url = urljoin(self.address, "query?" + urlencode({**parameters, "limit": _PAGE}, safe="/"))
        visited: set[str] = set()
        while url not in visited and len(visited) < _MAX_PAGES:
            visited.add(url)
            answer = self._answer(url)
            if "error" in answer:  # with HTTP 200: no such node
                return
            edges = answer.get("edges")
            if not isinstance(edges, list):
                raise ConceptNetError(f"{url} answered JSON without edges: is that ConceptNet?")
            yield from edges
            view = answer.get("view")
            following = view.get("nextPage") if isinstance(view, dict) else None
            if not edges or not isinstance(following, str):
                return
            url = self._same_service(urljoin(url, following))
        raise ConceptNetError(f"{url} repeats a page, or has more than {_MAX_PAGES} pages")

    def _same_service(self, url: str) -> str:
        if urlsplit(url)[:2] != urlsplit(self.address)[:2]:
            raise ConceptNetError(f"{self.address} links to a next page on another server: {url}")
        return url

    def _answer(self, url: str) -> dict[str, object]:
        if self.cache and (cached := self.cache.get(url)) is not None:
            return cached
        answer = self._parse(url, self._fetch(url))
        if self.cache:
            self.cache.put(url, answer)
        return answer

    def _fetch(self, url: str) -> bytes:
        for attempt in range(_ATTEMPTS):
            self.throttle.take()
            self.statistics.requests += 1
            wait, problem = 2.0**attempt, ""
            try:
                with self._session.get(url, timeout=_TIMEOUT, stream=True) as response:
                    if response.status_code == 200:
                        return _body(response)
                    problem = f"answers {response.status_code} {response.reason or ''}".strip()
                    if response.status_code != 429 and response.status_code < 500:
                        raise ConceptNetError(f"{url} {problem}: is that ConceptNet's address?")
                    wait = max(wait, _retry_after(response.headers.get("Retry-After", "")))
            except requests.RequestException as error:
                problem = f"cannot be reached ({type(error).__name__})"
            if attempt + 1 < _ATTEMPTS:
                self.sleep(min(wait, _MAX_WAIT))
        raise ConceptNetError(f"{self.address} {problem}, {_ATTEMPTS} times; {_FILES}")

    def _parse(self, url: str, body: bytes) -> dict[str, object]:
        try:
            answer = json.loads(body)
        except (ValueError, RecursionError):
            raise ConceptNetError(f"{url} did not answer JSON: is that ConceptNet?") from None
        if not isinstance(answer, dict):
            raise ConceptNetError(f"{url} answered JSON without edges: is that ConceptNet?")
        return answer


def read_api(
    client: ApiClient, names: TermMatcher, language: str, wanted: EdgeFilter, progress: Progress
) -> Iterator[Edge]:
    """Assertions of the service that pass the filter `wanted`; malformed edges are counted.

    Raises:
        ConceptNetError: as `ApiClient.edges`.
    """
    plan = _queries(names, language)
    for done, parameters in enumerate(plan):
        progress(done, len(plan))
        for edge in client.edges(**parameters):
            client.statistics.lines += 1
            try:
                assertion = parse_edge(edge, language, wanted)
            except MalformedEdgeError as error:
                client.statistics.skipped[str(error)] += 1
                continue
            if assertion is not None:
                yield assertion
    progress(len(plan), len(plan))


def _queries(names: TermMatcher, language: str) -> list[dict[str, str]]:
    """Queries: all relations of the objects, and those with a place or supercategory as end."""
    parameters = [
        (relation, end, term)
        for category in names.groups["object"]
        for term in names.terms(category)
        for relation, end in _OF_OBJECTS
    ]
    for kind, relation in (("place", "AtLocation"), ("supercategory", "IsA")):
        for category in names.groups[kind]:
            parameters += [(relation, "end", term) for term in names.terms(category)]
    return [
        {end: f"/c/{language}/{term.replace(' ', '_')}", "rel": f"/r/{relation}"}
        for relation, end, term in dict.fromkeys(parameters)
    ]


def _body(response: requests.Response) -> bytes:
    body = bytearray()
    for part in response.iter_content(1 << 16):
        body += part
        if len(body) > _MAX_BYTES:
            raise ConceptNetError(f"{response.url} answers more than {_MAX_BYTES >> 20} MB")
    return bytes(body)


def _retry_after(text: str) -> float:
    """Seconds of a Retry-After header, a number or a date; 0 where it is neither."""
    if text.strip().isascii() and text.strip().isdigit():
        return float(text)
    try:
        return max(0.0, (parsedate_to_datetime(text) - datetime.now(UTC)).total_seconds())
    except (ValueError, TypeError):
        return 0.0
