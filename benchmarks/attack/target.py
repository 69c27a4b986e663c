"""Target of the attacks: `hereabouts serve` in a process of its own, over a small map."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any, Self

import requests

from kg.serving.opening import create_map

TOKEN = "a-token-of-the-attacks-0123"
ROBOT = "a-token-of-a-robot-besides"
SECONDS = 2.0  # a query's time limit
PATIENCE = 8.0  # [s] within which a bystander's `ASK {}` is answered, however busy the server
MIXED = "\n".join(
    f"<urn:mixed:{k % 2}> <urn:value> {value} ."
    for k in range(800)
    for value in [(k, f"'{k}a'", k / 3, f"'{k}'")[k % 4]]
)
MAX_MEMORY = 2 << 20  # [kB] of the server's process
TRACEBACK = "Traceback (most recent call last)"
KEPT = "<urn:kept> <urn:says> 'kept' ."


class Target:
    """A running server; a context manager that ends it.

    Families draw their spellings from `rng`, so that another seed makes other attacks.
    """

    def __init__(self, folder: Path, seed: str = "1") -> None:
        self.rng = random.Random(seed)
        self._shown = 0
        self.folder = folder
        self.map = folder / "attacked.map"
        with create_map(self.map) as made:
            made.update(f"INSERT DATA {{ GRAPH <urn:g> {{ {MIXED} {KEPT} }} }}")
        tokens = folder / "tokens.txt"
        tokens.write_text(f"ann {TOKEN}\nrobot {ROBOT}\n")
        tokens.chmod(0o600)
        self._words = [sys.executable, "-m", "hereabouts.cli", "serve", str(self.map), "--port",
                       "0", "--token-file", str(tokens), "--timeout", str(SECONDS)]  # fmt: skip
        self._start()

    def _start(self) -> None:
        self._process = subprocess.Popen(self._words, stderr=subprocess.PIPE, text=True)
        assert self._process.stderr is not None
        line = self._process.stderr.readline()
        self.url = next(word for word in line.split() if word.startswith("http://"))
        threading.Thread(target=self._drain, args=(self._process.stderr,), daemon=True).start()

    def request(self, method: str, path: str, **given: Any) -> requests.Response | None:
        """The response; None where the server hung up, or did not answer in time."""
        headers = {"Authorization": f"Bearer {TOKEN}", **given.pop("headers", {})}
        given.setdefault("timeout", 10 * SECONDS)
        try:
            return requests.request(method, self.url + path, headers=headers, **given)
        except requests.RequestException:
            return None

    def query(self, sparql: str, **params: str) -> requests.Response | None:
        """The response to a query."""
        return self.request("POST", "sparql", data={"query": sparql, **params})

    def update(self, sparql: str) -> requests.Response | None:
        """The response to an update."""
        return self.request("POST", "sparql", data={"update": sparql})

    def crashed(self) -> int:
        """1 where the server has died since the last call, which is then started again; else 0."""
        if self._process.poll() is None:
            return 0
        self._start()
        return 1

    def hangs(self) -> int:
        """1 where a bystander's query is not answered in time, else 0."""
        started = time.monotonic()
        reply = self.request("GET", "sparql", params={"query": "ASK {}"}, timeout=PATIENCE)
        return int(
            reply is None or reply.status_code != 200 or time.monotonic() - started > PATIENCE
        )

    def lost(self) -> int:
        """1 where what was acknowledged at the start is gone, else 0."""
        reply = self.query(f"ASK {{ GRAPH <urn:g> {{ {KEPT} }} }}")
        return int(reply is None or b"true" not in reply.content)

    def memory(self) -> int:
        """Present memory of the server's process [MB]."""
        status = Path(f"/proc/{self._process.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0]) >> 10

    def ends_when_told(self, seconds: float) -> bool:
        """Whether SIGTERM ends the server within so many seconds; it is started again."""
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        self._start()
        return True

    def restarted(self) -> int:
        """1 where the killed server does not start again with its map, else 0."""
        self._process.kill()
        self._process.wait()
        try:
            self._start()
        except StopIteration:  # it ended with an error
            return 1
        return self.hangs()

    def greedy(self) -> int:
        """1 where the server's process took more than `MAX_MEMORY` since it began, else 0."""
        try:
            text = Path(f"/proc/{self._process.pid}/status").read_text(encoding="ascii")
        except OSError:
            return 0
        peaks = [int(line.split()[1]) for line in text.splitlines() if line.startswith("VmHWM")]
        return int(max(peaks, default=0) > MAX_MEMORY)

    def shown(self, *replies: requests.Response | None) -> int:
        """Tracebacks in these replies, and on the server's stderr since the last call."""
        shown, self._shown = self._shown, 0
        return shown + sum(TRACEBACK in reply.text for reply in replies if reply is not None)

    def _drain(self, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                self._shown += TRACEBACK in line

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.kill()
        self._process.wait()
