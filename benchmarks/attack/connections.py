"""Family of attacks: one address crowds the server, and bystanders ask `ASK {}` meanwhile.

    python -m benchmarks.attack.connections [KIND ...]   (prints the latencies of each kind)

Bystanders have addresses of their own. One keeps its connection, one opens a new one each time,
and one, at the address of the crowd, has a token.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np
import requests
from requests.adapters import HTTPAdapter

from benchmarks.attack.crowding import ADDRESS, KINDS
from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import PATIENCE, ROBOT, Target
from lab.command_line import parser_of

SECONDS: Final = 4.0  # of each kind
WARM_UP: Final = 2.0  # [s] in which the crowd arrives


@dataclass(frozen=True, slots=True)
class Latency:
    """The answers to a bystander: their times (n,) [s], and how many were refusals."""

    seconds: tuple[float, ...]
    refused: int

    @property
    def cells(self) -> tuple[object, ...]:
        """Answers, refusals, median and 99th percentile [ms]."""
        p50, p99 = np.percentile(self.seconds or [np.nan], [50, 99]) * 1000
        return len(self.seconds), self.refused, f"{p50:.0f}", f"{p99:.0f}"

    @property
    def held(self) -> bool:
        """Whether all was answered."""
        return bool(self.seconds) and not self.refused


class _FromAddress(HTTPAdapter):
    def __init__(self, address: str) -> None:
        self._address = address
        super().__init__()

    def init_poolmanager(self, *arguments: Any, **named: Any) -> None:
        super().init_poolmanager(*arguments, source_address=(self._address, 0), **named)


#: name -> address, token, whether each request has its own connection
BYSTANDERS: Final = {
    "kept": ("127.0.0.2", "", False),
    "new": ("127.0.0.3", "", True),
    "token": (ADDRESS, ROBOT, True),
}


def attack(target: Target) -> Outcome:
    """A bystander elsewhere who is refused, or waits longer than `PATIENCE`, is a hang.

    A new connection at the address of the crowd may be refused before its token arrives.
    """
    total = Outcome()
    for kind in KINDS:
        latencies = measure(target, kind)
        hangs = sum(not latencies[name].held for name in ("kept", "new"))
        total += Outcome(1, 0, target.crashed(), hangs + target.hangs(), target.lost())
    return total


def measure(target: Target, kind: str) -> dict[str, Latency]:
    """The answers to each bystander while one address crowds the server in this way."""
    found: dict[str, Latency] = {}

    def ask(name: str) -> None:
        found[name] = _ask(target.url, *BYSTANDERS[name])

    with _crowd(target.url, kind):
        threads = [threading.Thread(target=ask, args=(name,)) for name in BYSTANDERS]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    return found


@contextmanager
def _crowd(url: str, kind: str) -> Iterator[None]:
    words = [sys.executable, "-m", "benchmarks.attack.crowding", str(urlsplit(url).port), kind]
    with subprocess.Popen(words) as crowd:
        time.sleep(WARM_UP)
        try:
            yield
        finally:
            crowd.kill()


def _ask(url: str, address: str, token: str, anew: bool) -> Latency:
    times, refused, until = [], 0, time.monotonic() + SECONDS
    with requests.Session() as session:
        session.trust_env = False
        session.mount("http://", _FromAddress(address))
        session.headers.update({"Authorization": f"Bearer {token}"} if token else {})
        session.headers.update({"Connection": "close"} if anew else {})
        while time.monotonic() < until:
            begun = time.perf_counter()
            try:
                reply = session.get(url + "sparql", params={"query": "ASK {}"}, timeout=PATIENCE)
                answered = reply.status_code == 200
            except requests.RequestException:
                answered = False
            if answered:
                times.append(time.perf_counter() - begun)
            refused += not answered
            time.sleep(0.02)
    return Latency(tuple(times), refused)


def main() -> None:
    """Print a row for each kind in Markdown: answers, refusals, p50, p99 of each bystander."""
    parser = parser_of("benchmarks.attack.connections", __doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of: {', '.join(KINDS)}")
    kinds = parser.parse_args().kinds
    sys.stdout.write("| kind | bystander | answers | refused | p50 ms | p99 ms | memory MB |\n")
    sys.stdout.write("|---|---|---|---|---|---|---|\n")
    for kind in kinds or KINDS:
        with tempfile.TemporaryDirectory() as folder, Target(Path(folder)) as target:
            before = target.memory()
            for name, latency in measure(target, kind).items():
                memory = f"{before} to {target.memory()}"
                cells = (kind, name, *latency.cells, memory)
                sys.stdout.write("| " + " | ".join(map(str, cells)) + " |\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
