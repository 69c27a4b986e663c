"""Latency of a served map, alone and beside a runaway query.

    python -m benchmarks.server [OBJECTS ...]        (from the repository's root; 1000 100000)

One client on one connection, over loopback. Prints a table in Markdown: median, p95 and p99 [ms],
and each median as a multiple of that of /health, which only answers, in the same run.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import requests

from benchmarks.made_maps import ASK, RUNAWAY, fill, milliseconds, writer
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map, open_map
from kg.serving.server import Limits, MapServer, Settings
from lab.command_line import parser_of

LOOKUP = "SELECT ?p ?o {<urn:object:7> ?p ?o}"
CUPS = "SELECT ?o ?x {?o a here:Cup ; here:x ?x} ORDER BY ?x LIMIT 20"
LIMITS = Limits(query_seconds=8.0)
REPEATS = 300
SECONDS = 10.0  # or so long


def main() -> None:
    """Measure each size given, or a thousand and a hundred thousand objects."""
    parser = parser_of("benchmarks.server", __doc__)
    parser.add_argument("objects", nargs="*", type=int, default=[1_000, 100_000])
    sizes = parser.parse_args().objects
    sys.stdout.write("| objects | what | n | median | p95 | p99 | times /health |\n")
    sys.stdout.write("|---|---|---|---|---|---|---|\n")
    for objects in sizes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "one"
            with create_map(path, base="urn:one/") as made:
                fill(made, objects)
            _measure(path, objects)


def _measure(path: Path, objects: int) -> None:
    with (
        open_map(path) as semantic_map,
        MapServer(semantic_map, Settings(port=0, limits=LIMITS)) as server,
    ):
        client = _Client(server.url, objects)
        client.report("/health", "health")
        for name, query in (("ASK", ASK), ("a thing's facts", LOOKUP), ("top 20 of a class", CUPS)):
            client.report(name, "sparql", query=query)
        client.report("linked data, Turtle", "resource", iri="urn:object:7")
        client.report("linked data, page", "resource", accept="text/html", iri="urn:object:7")
        client.report("front page", "", accept="text/html")
        _beside(client, server.url, lambda: client.once("sparql", query=ASK))
        _beside_writer(client, semantic_map)


class _Client:
    """Asks over one connection, and prints how long it took."""

    def __init__(self, url: str, objects: int, least: float = 0.0) -> None:
        self._url, self._objects, self.least = url, objects, least
        self._session = requests.Session()
        self._session.trust_env = False

    def once(self, path: str, accept: str = "*/*", **params: str) -> float:
        """Seconds of one answer."""
        begun = time.perf_counter()
        answer = self._session.get(self._url + path, params=params, headers={"Accept": accept})
        seconds = time.perf_counter() - begun
        assert answer.status_code == 200, answer.text
        return seconds

    def report(self, what: str, path: str, accept: str = "*/*", **params: str) -> None:
        """A row of the table."""
        for _ in range(3):
            self.once(path, accept, **params)
        times: list[float] = []
        while len(times) < REPEATS and sum(times) < SECONDS:
            times.append(self.once(path, accept, **params))
        self.row(what, times)

    def row(self, what: str, seconds: list[float]) -> None:
        """A row of the table, of given times."""
        p50, p95, p99 = milliseconds(seconds, 50, 95, 99)
        self.least = self.least or p50
        sys.stdout.write(
            f"| {self._objects:,} | {what} | {len(seconds)} | {p50:.2f} | {p95:.2f} | {p99:.2f} | "
            f"{p50 / self.least:.1f} |\n"
        )
        sys.stdout.flush()


def _beside(client: _Client, url: str, act: Callable[[], float]) -> None:
    """ASK while a query runs that never ends by itself."""
    statuses: list[int] = []

    def run_away() -> None:
        given = {"query": RUNAWAY}
        statuses.append(requests.get(url + "sparql", params=given, timeout=60).status_code)

    runaway = threading.Thread(target=run_away)
    runaway.start()
    time.sleep(0.2)
    times = []
    while runaway.is_alive() and len(times) < 2000:
        times.append(act())
    runaway.join()
    assert statuses[0] in (503, 504), "the runaway query ended by itself; make it bigger"
    client.row("ASK beside a runaway query", times)


def _beside_writer(client: _Client, semantic_map: SemanticMap) -> None:
    """ASK while 30 commits a second are made in the server's process."""
    until = time.monotonic() + 5
    times = []
    with writer(semantic_map):
        while time.monotonic() < until:
            times.append(client.once("sparql", query=ASK))
    client.row("ASK beside a writer at 30 Hz", times)


if __name__ == "__main__":
    main()
