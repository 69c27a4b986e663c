"""A follower of the feed: a copy of the map made of nothing but its changes.

It reads the map once, at its beginning, and from then on only `/changes`; when the server dies it
comes back with `Last-Event-ID`. It runs in a process that outlives every server.
"""

from __future__ import annotations

import http.client
import json
import os
import threading
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import quote, urlsplit

from pyoxigraph import (
    Quad,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
    parse,
    parse_query_results,
)

from benchmarks.kills.examination import digest, isomorphic_digest
from benchmarks.kills.processes import Child
from kg.model import vocabulary as v

_EVERYTHING = "SELECT ?s ?p ?o ?g { GRAPH ?g { ?s ?p ?o } }"
_BROKEN = (OSError, http.client.HTTPException, EOFError)
Told = Callable[[Any], None]


class Follower:
    """The follower's process, as the parent sees it: told of addresses and moments."""

    def __init__(self) -> None:
        reading, self._writing = os.pipe()

        def work(told: Told) -> None:
            os.close(self._writing)
            _Copy(told).obey(reading)

        self._child = Child(work)
        os.close(reading)

    def say(self, what: str, value: object) -> None:
        """`url` ADDRESS, `at` SEQUENCE (have it tell its digest there), or `end` None."""
        os.write(self._writing, json.dumps([what, value]).encode() + b"\n")

    def hear(self, within: float) -> Any:
        """Its next message."""
        return self._child.hear(within)

    def end(self) -> dict[str, Any]:
        """Its last words: counts, what went wrong, and the digest of all it holds."""
        self.say("end", None)
        os.close(self._writing)
        try:
            while True:
                message = self._child.hear(120.0)
                if "events" in message:
                    return dict(message)
        finally:
            self._child.end()
            self._child.close()


class _Copy:
    def __init__(self, told: Told) -> None:
        self._told = told
        self._guard = threading.Lock()
        self._graph: set[Quad] | None = None
        self._sequence = 0
        self._wanted: list[int] = []
        self._events = self._resumed = self._cut = 0
        self._wrong: list[str] = []

    def obey(self, orders: int) -> None:
        """Do as the parent says, until it says to end."""
        following: threading.Thread | None = None
        with os.fdopen(orders) as lines:
            for line in lines:
                what, value = json.loads(line)
                if what == "url":
                    if following is not None:
                        following.join()  # what the dead server still sent comes first
                    following = threading.Thread(target=self._follow, args=(value,), daemon=True)
                    following.start()
                elif what == "at":
                    with self._guard:
                        self._wanted.append(value)
                        self._tell()
                else:
                    self._end()

    def _follow(self, url: str) -> None:
        try:
            if self._graph is None:
                self._begin(url)
            else:
                self._resumed += 1
            for number, removed, added in _events(url, self._sequence):
                with self._guard:
                    self._apply(number, removed, added)
        except _BROKEN:
            pass  # the server was killed

    def _begin(self, url: str) -> None:
        body = _get(url, f"sparql?query={quote(_EVERYTHING)}", "application/sparql-results+json")
        answer = parse_query_results(body, format=QueryResultsFormat.JSON)
        assert isinstance(answer, QuerySolutions)
        with self._guard:
            self._graph = {Quad(row["s"], row["p"], row["o"], row["g"]) for row in answer}
            if any(quad.predicate.value == v.SEQUENCE for quad in self._graph):
                self._wrong.append("the follower did not begin at #0")
            self._tell()

    def _apply(self, number: int, removed: set[Quad], added: set[Quad]) -> None:
        assert self._graph is not None
        if number != self._sequence + 1:
            self._wrong.append(f"the feed went from #{self._sequence} to #{number}")
        if not removed <= self._graph or added & self._graph:
            self._wrong.append(f"#{number} removes what is not there, or adds what is")
        self._graph -= removed
        self._graph |= added
        self._sequence = number
        self._events += 1
        self._tell()

    def _tell(self) -> None:
        if self._graph is None:
            return
        for number in [n for n in self._wanted if n <= self._sequence]:
            self._wanted.remove(number)
            if number < self._sequence:
                # told of a commit that the map then did not have
                self._wrong.append(f"at #{self._sequence} when the map was at #{number}")
            self._told({"at": number, "digest": digest(self._graph)})

    def _end(self) -> None:
        with self._guard:
            found = isomorphic_digest(self._graph or ())
            self._told(
                {
                    "events": self._events,
                    "resumed": self._resumed,
                    "at": self._sequence,
                    "digest": found,
                    "wrong": self._wrong,
                }
            )


def _events(url: str, since: int) -> Iterator[tuple[int, set[Quad], set[Quad]]]:
    """Changes after `since` as they come; an event that a kill cut off is not one."""
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=120)
    try:
        connection.request("GET", "/changes", headers={"Last-Event-ID": str(since)})
        answer = connection.getresponse()
        if answer.status != 200:
            raise AssertionError(f"/changes answered {answer.status}: {answer.read()!r}")
        data = b""
        while line := answer.readline():
            if line.startswith(b"data: "):
                data = line[6:]
            elif line == b"\n" and data:
                told = json.loads(data)
                yield told["sequence"], _quads(told["removed"]), _quads(told["added"])
                data = b""
    finally:
        connection.close()


def _get(url: str, path: str, accept: str) -> bytes:
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=120)
    try:
        connection.request("GET", f"/{path}", headers={"Accept": accept})
        answer = connection.getresponse()
        body = answer.read()
        if answer.status != 200:
            raise AssertionError(f"{path} answered {answer.status}: {body!r}")
        return body
    finally:
        connection.close()


def _quads(lines: list[str]) -> set[Quad]:
    return set(parse("\n".join(lines), format=RdfFormat.N_QUADS))
