"""ConceptNet's web API: what it says of our categories, page by page, no faster than it allows."""

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

from kg.conceptnet.assertion import Assertion, Unreadable
from kg.conceptnet.cache import Cache
from kg.conceptnet.dump import Progress, Reading, Wanted
from kg.conceptnet.names import Names
from kg.conceptnet.tables5 import parse_edge
from kg.conceptnet.throttle import Throttle
from kg.errors import ConceptNetError

_PAGE: Final = 1000  # edges; the most the service gives at once
_MOST_PAGES: Final = 101  # offsets end at 100,000
_ATTEMPTS: Final = 5
_LONGEST_WAIT: Final = 600.0  # [s] however long the service asks us to wait
_LARGEST: Final = 64 << 20  # bytes of an answer
_TIMEOUT: Final = (10.0, 60.0)  # [s] to connect, and between bytes
_FILES: Final = (
    "the public service is often down: import a file instead, the assertions of "
    "github.com/commonsense/conceptnet5/wiki/Downloads (--from FILE)"
)
#: (relation, which end our object's name is asked as)
_OF_OBJECTS: Final = (
    *(("AtLocation", "start"), ("PartOf", "start"), ("IsA", "start")),
    *(("HasA", "end"), ("LocatedNear", "node"), ("Synonym", "node")),
)


@dataclass(slots=True)
class Client:
    """One service, asked with its limits, retried when it is busy, remembered in a cache."""

    address: str
    cache: Cache | None = None
    throttle: Throttle = field(default_factory=Throttle)
    sleep: Callable[[float], None] = time.sleep
    reading: Reading = field(default_factory=Reading)
    _session: requests.Session = field(default_factory=requests.Session)

    def __post_init__(self) -> None:
        parts = urlsplit(self.address)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ConceptNetError(f"{self.address!r} is no http(s) address and no file")
        self.address = self.address.rstrip("/") + "/"
        self._session.headers.update({"Accept": "application/json"})

    def close(self) -> None:
        """Let go of the connection."""
        self._session.close()

    def edges(self, **asked: str) -> Iterator[object]:
        """All edges of a query (start, end, node, rel), through all its pages.

        Raises:
            ConceptNetError: the service fails, refuses, or answers what it should not.
        """
        url = urljoin(self.address, "query?" + urlencode({**asked, "limit": _PAGE}, safe="/"))
        seen: set[str] = set()
        while url not in seen and len(seen) < _MOST_PAGES:
            seen.add(url)
            answer = self._answer(url)
            if "error" in answer:  # with HTTP 200: it knows no such node
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
        raise ConceptNetError(f"{url} leads back to itself, or to more pages than it may")

    def _same_service(self, url: str) -> str:
        if urlsplit(url)[:2] != urlsplit(self.address)[:2]:
            raise ConceptNetError(f"{self.address} sends us elsewhere for more: {url}")
        return url

    def _answer(self, url: str) -> dict[str, object]:
        if self.cache and (known := self.cache.get(url)) is not None:
            return known
        answer = self._parse(url, self._fetch(url))
        if self.cache:
            self.cache.put(url, answer)
        return answer

    def _fetch(self, url: str) -> bytes:
        for attempt in range(_ATTEMPTS):
            self.throttle.take()
            self.reading.requests += 1
            wait, trouble = 2.0**attempt, ""
            try:
                with self._session.get(url, timeout=_TIMEOUT, stream=True) as response:
                    if response.status_code == 200:
                        return _body(response)
                    trouble = f"answers {response.status_code} {response.reason or ''}".strip()
                    if response.status_code != 429 and response.status_code < 500:
                        raise ConceptNetError(f"{url} {trouble}: is that ConceptNet's address?")
                    wait = max(wait, _retry_after(response.headers.get("Retry-After", "")))
            except requests.RequestException as error:
                trouble = f"cannot be reached ({type(error).__name__})"
            if attempt + 1 < _ATTEMPTS:
                self.sleep(min(wait, _LONGEST_WAIT))
        raise ConceptNetError(f"{self.address} {trouble}, {_ATTEMPTS} times; {_FILES}")

    def _parse(self, url: str, body: bytes) -> dict[str, object]:
        try:
            answer = json.loads(body)
        except (ValueError, RecursionError):
            raise ConceptNetError(f"{url} did not answer JSON: is that ConceptNet?") from None
        if not isinstance(answer, dict):
            raise ConceptNetError(f"{url} answered JSON without edges: is that ConceptNet?")
        return answer


def read_api(
    client: Client, names: Names, language: str, wanted: Wanted, progress: Progress
) -> Iterator[Assertion]:
    """Every assertion the service has that is wanted; edges that are none are counted.

    Raises:
        ConceptNetError: as `Client.edges`.
    """
    plan = _queries(names, language)
    for done, asked in enumerate(plan):
        progress(done, len(plan))
        for edge in client.edges(**asked):
            client.reading.lines += 1
            try:
                assertion = parse_edge(edge, language, wanted)
            except Unreadable as error:
                client.reading.skipped[str(error)] += 1
                continue
            if assertion is not None:
                yield assertion
    progress(len(plan), len(plan))


def _queries(names: Names, language: str) -> list[dict[str, str]]:
    """What to ask: everything of our objects, and what is at our places or is of our kinds."""
    asked = [
        (relation, end, term)
        for category in names.groups["object"]
        for term in names.terms(category)
        for relation, end in _OF_OBJECTS
    ]
    for kind, relation in (("place", "AtLocation"), ("supercategory", "IsA")):
        for category in names.groups[kind]:
            asked += [(relation, "end", term) for term in names.terms(category)]
    return [
        {end: f"/c/{language}/{term.replace(' ', '_')}", "rel": f"/r/{relation}"}
        for relation, end, term in dict.fromkeys(asked)
    ]


def _body(response: requests.Response) -> bytes:
    body = bytearray()
    for part in response.iter_content(1 << 16):
        body += part
        if len(body) > _LARGEST:
            raise ConceptNetError(f"{response.url} answers more than {_LARGEST >> 20} MB")
    return bytes(body)


def _retry_after(text: str) -> float:
    """Seconds that the service asks us to wait: a number, or a date; 0 where it says nothing."""
    if text.strip().isascii() and text.strip().isdigit():
        return float(text)
    try:
        return max(0.0, (parsedate_to_datetime(text) - datetime.now(UTC)).total_seconds())
    except (ValueError, TypeError):
        return 0.0
