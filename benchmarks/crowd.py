"""Latency of one client's `ASK {}` on a served map while others are greedy, write, or dump.

    python -m benchmarks.crowd [OBJECTS [ROW ...]]   (from the repository's root; 1000, all rows)

The server is a process of its own, clients are threads on the loopback with tokens of their own.
Prints a table in Markdown: answers, refusals, median and p95 [ms] of the bystander, and of writes.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import requests

SECONDS = 8.0  # of each row
GREEDY, WRITER = "a-token-of-a-greedy-client", "a-token-of-somebody-who-writes"
RUNAWAY = "SELECT (COUNT(*) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i. ?j ?k ?l}"
SLOW = "SELECT (COUNT(*) AS ?n) {?a ?b ?c. ?d ?e ?f. ?x <urn:moved> ?y}"
CONNECTIONS = 500
Act = Callable[[str], None]


class Server:
    """A running `hereabouts serve` over a map of `objects`; a context manager."""

    def __init__(self, folder: Path, objects: int) -> None:
        path, tokens, data = folder / "crowd.map", folder / "tokens", folder / "objects.rq"
        tokens.write_text(f"greedy {GREEDY}\nwriter {WRITER}\n")
        lines = (
            f"<urn:o:{n}> <urn:x> {n / 7} ; <urn:at> <urn:p:{n % 9}> ." for n in range(objects)
        )
        data.write_text("INSERT DATA { GRAPH <urn:objects> { " + "\n".join(lines) + " } }")
        made = "from kg.maps.semantic_map import SemanticMap as M; M.create"
        if subprocess.run(
            [sys.executable, "-c", "import kg.serving.opening"], capture_output=True
        ).returncode:
            code = f"import sys; {made}(sys.argv[1]).close()"
        else:
            made = "import sys; from kg.serving.opening import create_map"
            code = f"{made}; create_map(sys.argv[1]).close()"
        subprocess.run([sys.executable, "-c", code, str(path)], check=True)
        words = [sys.executable, "-m", "hereabouts.cli", "serve", str(path), "--port", "0"]
        self._process = subprocess.Popen(
            [*words, "--token-file", str(tokens)], stderr=subprocess.PIPE, text=True
        )
        assert self._process.stderr is not None
        line = " "
        while line and (found := re.search(r" at (http://\S+/) ", line)) is None:
            line = self._process.stderr.readline()
        assert found is not None, "the server did not start"
        self.url = found[1]
        threading.Thread(target=self._process.stderr.read, daemon=True).start()
        assert post(self.url, WRITER, update=data.read_text()) == 200

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.terminate()
        self._process.wait(60)


def post(url: str, token: str, session: requests.Session | None = None, **form: str) -> int:
    """Status of a POST to /sparql; 0 where none came."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    try:
        with (session or requests).post(
            url + "sparql", data=form, headers=headers, timeout=60
        ) as answer:
            return answer.status_code
    except requests.RequestException:
        return 0


def main() -> None:
    """Measure each row against a fresh server."""
    objects = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000
    sys.stdout.write("| beside | who | answers | refused | median ms | p95 ms |\n")
    sys.stdout.write("|---|---|---|---|---|---|\n")
    rows: list[tuple[str, Act, int, bool]] = [
        ("nothing", _wait, 1, False),
        (f"{CONNECTIONS} runaway queries of one client", _run_away, CONNECTIONS, False),
        ("16 slow standing queries and a writer", _stand, 16, False),
        ("a writer over HTTP", _write_on, 1, False),
        ("nothing", _wait, 1, True),
        ("24 dumps at once", _dump, 24, True),
    ]
    wanted = [int(row) for row in sys.argv[2:]] or range(len(rows))
    for name, act, threads, writes in (rows[row] for row in wanted):
        with (
            tempfile.TemporaryDirectory() as folder,
            Server(Path(folder), objects) as server,
            _crowd(server.url, act, threads),
        ):
            times, refused = _measure(server.url, writes)
        who = "update" if writes else "ASK {}"
        p50, p95 = np.percentile(times or [np.nan], [50, 95]) * 1000
        cells = (name, who, len(times), refused, f"{p50:.1f}", f"{p95:.1f}")
        sys.stdout.write("| " + " | ".join(map(str, cells)) + " |\n")
        sys.stdout.flush()


def _measure(url: str, writes: bool) -> tuple[list[float], int]:
    times, refused, until = [], 0, time.monotonic() + SECONDS
    with requests.Session() as session:
        session.trust_env = False
        while time.monotonic() < until:
            update = f"INSERT DATA {{ <urn:n:{len(times)}> rdfs:comment 'n' }}"
            form = {"update": update} if writes else {"query": "ASK {}"}
            begun = time.perf_counter()
            status = post(url, WRITER if writes else "", session, **form)
            if status == 200:
                times.append(time.perf_counter() - begun)
            else:
                refused += 1
            time.sleep(0.01)
    return times, refused


@contextmanager
def _crowd(url: str, act: Act, threads: int) -> Iterator[None]:
    """A process of its own at lower priority, so that it does not slow the bystander itself."""
    crowd = multiprocessing.get_context("spawn").Process(target=_act, args=(url, act, threads))
    crowd.start()
    time.sleep(4.0)
    try:
        yield
    finally:
        crowd.kill()
        crowd.join()


def _act(url: str, act: Act, threads: int) -> None:
    os.nice(10)
    running = [threading.Thread(target=act, args=(url,), daemon=True) for _ in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()


def _wait(url: str) -> None:
    return


def _run_away(url: str) -> None:
    while True:
        if post(url, GREEDY, query=RUNAWAY) != 504:
            time.sleep(5.0)  # as Retry-After asks


def _stand(url: str) -> None:
    headers = {"Authorization": f"Bearer {GREEDY}"}
    with requests.get(
        url + "subscribe", {"query": SLOW}, headers=headers, stream=True, timeout=120
    ):
        while True:
            moved = f"<urn:a> <urn:moved> {time.time()}"
            post(url, WRITER, update=f"INSERT DATA {{ GRAPH <urn:objects> {{ {moved} }} }}")
            time.sleep(1.0)


def _write_on(url: str) -> None:
    number = 0
    while True:
        number += 1
        post(url, WRITER, update=f"INSERT DATA {{ <urn:w:{number}> rdfs:comment 'w' }}")


def _dump(url: str) -> None:
    while True:
        with requests.get(url + "dump.nq", timeout=60) as answer:
            if not answer.ok:
                time.sleep(5.0)


if __name__ == "__main__":
    main()
