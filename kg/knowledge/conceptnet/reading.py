"""Reading of ConceptNet: edges from files or pipes, and from a web API.

Files and pipes, plain or gzip, are read line by line in bounded memory. The format is
detected from the lines, not from the name:

- ConceptNet 5 assertions: five columns between tabs, the first an assertion's URI, the last JSON;
- ConceptNet 4 graph: three columns, the last a Python dictionary of freq, score and rel.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import math
import os
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from itertools import chain, count
from pathlib import Path
from typing import IO, Final
from urllib.parse import urlencode, urljoin, urlsplit

import requests

from kg.knowledge.conceptnet.edges import (
    Edge,
    EdgeFilter,
    MalformedEdgeError,
    is_conceptnet4,
    is_conceptnet5,
    parse_edge,
    parse_line4,
    parse_line5,
)
from kg.knowledge.conceptnet.names import TermMatcher
from kg.model.errors import ConceptNetError

MAX_LINE: Final = 1 << 20  # bytes; far more than any line of the real files
_CHUNK: Final = 1 << 20
_REPORTED: Final = 10_000  # lines between two reports of progress
_SNIFFED: Final = 1000  # lines read to detect the format
_GZIP: Final = b"\x1f\x8b"

#: Callback with (bytes read, total bytes).
Progress = Callable[[int, int], None]


@dataclass(slots=True)
class DumpStatistics:
    """Statistics of reading a source, updated while it is read."""

    lines: int = 0  # lines of a file, or edges of an answer
    skipped: Counter[str] = field(default_factory=Counter)  # why -> how many
    requests: int = 0  # to the web API


def read_dump(
    path: Path, language: str, wanted: EdgeFilter, statistics: DumpStatistics, progress: Progress
) -> Iterator[Edge]:
    """Assertions of a file in `language` that pass the filter `wanted`.

    Malformed lines are counted in `statistics`, by reason.

    Raises:
        ConceptNetError: the file is missing, truncated, or in neither format.
    """
    with _opened(path) as (raw, unpacked):
        lines = _lines(unpacked, statistics, _report(raw, path, progress))
        first, parse = _sniff(lines, path, statistics)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about invalid escapes in a Python dictionary
            for line in chain(first, lines):
                yield from _parsed(parse, line, language, wanted, statistics)


_Parse = Callable[[bytes, str, EdgeFilter], Edge | None]
_FORMATS: Final[tuple[tuple[Callable[[bytes], bool], _Parse], ...]] = (
    (is_conceptnet5, parse_line5),
    (is_conceptnet4, parse_line4),
)


def _parsed(
    parse: _Parse, line: bytes, language: str, wanted: EdgeFilter, statistics: DumpStatistics
) -> Iterator[Edge]:
    try:
        assertion = parse(line, language, wanted)
    except UnicodeDecodeError:
        statistics.skipped["not UTF-8"] += 1
    except MalformedEdgeError as error:
        statistics.skipped[str(error)] += 1
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        statistics.skipped["no data in it"] += 1
    else:
        if assertion is not None:
            yield assertion


@contextmanager
def _opened(path: Path) -> Iterator[tuple[IO[bytes], IO[bytes]]]:
    try:
        with path.open("rb") as raw:
            packed = raw.peek(2)[:2] == _GZIP  # a pipe cannot seek
            yield raw, io.BufferedReader(gzip.GzipFile(fileobj=raw), _CHUNK) if packed else raw
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        reason = " ".join(str(error).split())
        raise ConceptNetError(
            f"{path}: the gzip data is truncated or damaged ({reason}); fetch the file again"
        ) from None
    except OSError as error:
        raise ConceptNetError(f"{path}: {error.strerror or error}") from None


def _report(raw: IO[bytes], path: Path, progress: Progress) -> Callable[[], None]:
    if not raw.seekable():
        return lambda: None
    total = path.stat().st_size
    return lambda: progress(raw.tell(), total)


def _lines(
    file: IO[bytes], statistics: DumpStatistics, report: Callable[[], None]
) -> Iterator[bytes]:
    """Lines without line ends; empty ones are omitted, and too long ones counted and omitted."""
    for number in count():
        if not number % _REPORTED:
            report()
        line = file.readline(MAX_LINE + 1)
        if not line:
            return
        if line.isspace():
            continue
        statistics.lines += 1
        if len(line) <= MAX_LINE or line.endswith(b"\n"):
            yield line.removesuffix(b"\n")
            continue
        statistics.skipped["line too long"] += 1
        while line and not line.endswith(b"\n"):
            line = file.readline(MAX_LINE)


def _sniff(
    lines: Iterator[bytes], path: Path, statistics: DumpStatistics
) -> tuple[list[bytes], _Parse]:
    """The lines read so far, and the parser for the detected format."""
    lines_read: list[bytes] = []
    for line in lines:
        lines_read.append(line)
        for has_form, parse in _FORMATS:
            if has_form(line):
                return lines_read, parse
        if len(lines_read) >= _SNIFFED:
            break
    none = f"none of its first {len(lines_read)} lines is one"
    what = none if statistics.lines else "it is empty"
    raise ConceptNetError(
        f"{path} holds no ConceptNet assertions ({what}): expected the TSV of ConceptNet 5 "
        "(5 columns, the first /a/[...]) or the graph of ConceptNet 4 (3 columns), plain or gzip"
    )


_INTERVAL: Final = 1.0  # [s] between requests; the service allows 120 a minute and 3,600 an hour
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
#: (relation, end of the edge with the object's term)
_OF_OBJECTS: Final = (
    *(("AtLocation", "start"), ("PartOf", "start"), ("IsA", "start")),
    *(("HasA", "end"), ("LocatedNear", "node"), ("Synonym", "node")),
)


@dataclass(frozen=True, slots=True)
class ResponseCache:
    """Response cache in a folder, with a file for each URL; damaged files are ignored."""

    folder: Path

    def get(self, url: str) -> dict[str, object] | None:
        """The cached response for a URL, or None."""
        try:
            stored = json.loads(self._path(url).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(stored, dict) or stored.get("url") != url:
            return None
        answer = stored.get("answer")
        return answer if isinstance(answer, dict) else None

    def put(self, url: str, answer: dict[str, object]) -> None:
        """Store a response atomically.

        Raises:
            ConceptNetError: the folder cannot be written.
        """
        path = self._path(url)
        part = path.with_suffix(f".{os.getpid()}.part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps({"url": url, "answer": answer}))
            part.replace(path)
        except OSError as error:
            raise ConceptNetError(f"cache {self.folder}: {error.strerror or error}") from None

    def _path(self, url: str) -> Path:
        return self.folder / f"{hashlib.sha256(url.encode()).hexdigest()[:32]}.json"


@dataclass(slots=True)
class ApiClient:
    """HTTP client of one service, with a rate limit, retries and a cache of responses."""

    address: str
    cache: ResponseCache | None = None
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    statistics: DumpStatistics = field(default_factory=DumpStatistics)
    _session: requests.Session = field(default_factory=requests.Session)
    _last_request: float = -math.inf  # [s] by `clock`

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
            if "error" in answer:  # no such node; the status is 200
                return
            edges = answer.get("edges")
            if not isinstance(edges, list):
                raise ConceptNetError(f"{url} answered JSON without edges: is that ConceptNet?")
            yield from edges
            view = answer.get("view")
            following = view.get("nextPage") if isinstance(view, dict) else None
            if not edges or not isinstance(following, str):
                return
            url = urljoin(url, following)
            if urlsplit(url)[:2] != urlsplit(self.address)[:2]:
                raise ConceptNetError(
                    f"{self.address} links to a next page on another server: {url}"
                )
        raise ConceptNetError(f"{url} repeats a page, or has more than {_MAX_PAGES} pages")

    def _answer(self, url: str) -> dict[str, object]:
        if self.cache and (cached := self.cache.get(url)) is not None:
            return cached
        try:
            answer = json.loads(self._fetch(url))
        except (ValueError, RecursionError):
            raise ConceptNetError(f"{url} did not answer JSON: is that ConceptNet?") from None
        if not isinstance(answer, dict):
            raise ConceptNetError(f"{url} answered JSON without edges: is that ConceptNet?")
        if self.cache:
            self.cache.put(url, answer)
        return answer

    def _fetch(self, url: str) -> bytes:
        for attempt in range(_ATTEMPTS):
            self._wait_for_interval()
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

    def _wait_for_interval(self) -> None:
        if (wait := self._last_request + _INTERVAL - self.clock()) > 0:
            self.sleep(wait)
        self._last_request = self.clock()


def read_api(
    client: ApiClient, names: TermMatcher, language: str, wanted: EdgeFilter, progress: Progress
) -> Iterator[Edge]:
    """Edges of the service that pass the filter `wanted`; malformed edges are counted.

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
    """Queries for all relations of objects, and for relations that end at other categories."""
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
    """Seconds of a Retry-After header, which is a number or a date; 0 for other texts."""
    if text.strip().isascii() and text.strip().isdigit():
        return float(text)
    try:
        return max(0.0, (parsedate_to_datetime(text) - datetime.now(UTC)).total_seconds())
    except (ValueError, TypeError):
        return 0.0
