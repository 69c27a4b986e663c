"""The server killed: frames inside it, updates over HTTP, and a follower of its feed.

Each server maps frames on a thread of its own while a client posts updates, one after the other,
and notes which were acknowledged. The follower resumes at every new server, so that it too meets
kills while it catches up.
"""

from __future__ import annotations

import http.client
import random
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from benchmarks.kills.examination import Known
from benchmarks.kills.following import Follower
from benchmarks.kills.frames import frame_update, note_update
from benchmarks.kills.processes import Child
from benchmarks.kills.tally import Tally
from benchmarks.kills.writing import AT_WORK, create, replayed, settle
from kg.serving.opening import open_map
from kg.serving.server import BearerTokens, Limits, MapServer, Settings

MAX_DELAY = 0.7  # [s] from when the server answers, or has its first frame, to the kill
A_MAP = 50  # kills of one map and one follower
TOKEN = "the-token-of-the-killed-servers"
WITHIN = 120.0  # [s] a server may take to start, a follower to catch up
PAUSE = 0.01  # [s] between two frames
Told = Callable[[Any], None]


def kill_servers(
    folder: Path, kills: int, rng: random.Random, on_kill: Callable[[], None]
) -> Tally:
    """So many kills at moments drawn from `rng`, each followed by an examination."""
    tally = Tally("server, with a follower")
    events = resumed = 0
    while tally.kills < kills:
        path = folder / f"server-{tally.kills}.map"
        create(path)
        house = _House(path, Follower(), Known(), {}, tally)
        house.begin()
        for _ in range(min(A_MAP, kills - tally.kills)):
            house.one(rng)
            on_kill()
        counts = house.last()
        events, resumed = events + counts["events"], resumed + counts["resumed"]
    tally.notes = [f"{events:,} events followed, resumed {resumed:,} times"]
    return tally


@dataclass(slots=True)
class _House:
    """A map through all its servers, and the follower that outlives them."""

    path: Path
    follower: Follower
    known: Known
    digests: dict[int, str]  # of the map after each kill, that the follower has yet to reach
    tally: Tally

    def begin(self) -> None:
        """Let the follower read the map at its very beginning."""
        server = Child(lambda told: _serve(self.path, None, told))
        self.follower.say("url", server.hear(WITHIN))
        self.settled("", Known())
        self._compare(WITHIN)
        server.kill()
        server.close()

    def settled(self, digest: str, known: Known) -> None:
        """After a kill the map is here: the follower is to say what it holds when it is."""
        self.known = known
        self.digests[known.sequence] = digest
        self.follower.say("at", known.sequence)

    def one(self, rng: random.Random) -> None:
        """A server from its start to its kill."""
        server = Child(lambda told: _serve(self.path, self.known.frames, told))
        if rng.random() < 0.1:  # before it answers
            time.sleep(rng.uniform(0.0, 0.3))
            server.kill()
            self._after(server, (), rng)
            return
        url = server.hear(WITHIN)
        self.follower.say("url", url)
        client = Child(lambda told: _write(url, self.known.notes, told))
        first = [server.hear(WITHIN)] if rng.random() < AT_WORK else []
        time.sleep(rng.uniform(0.0, MAX_DELAY))
        server.kill()
        notes = list(client.rest())
        client.end()
        client.close()
        self._after(server, notes, rng, first)

    def last(self) -> dict[str, Any]:
        """Let the follower catch up with the last server, and compare everything."""
        server = Child(lambda told: _serve(self.path, None, told))
        self.follower.say("url", server.hear(WITHIN))
        while self.digests:
            self._compare(WITHIN)
        server.kill()
        server.close()
        counts = self.follower.end()
        stored, wrong = replayed(self.path)
        self.tally.wrong += [*wrong, *counts["wrong"]]
        if counts["digest"] != stored:
            self.tally.wrong.append(f"{self.path.name}: the follower is not isomorphic to the map")
        self.tally.checks += 1
        return counts

    def _after(
        self, server: Child, notes: Iterable[int], rng: random.Random, first: Iterable[int] = ()
    ) -> None:
        frames = [*first]
        frames += [message for message in server.rest() if isinstance(message, int)]
        server.close()
        acknowledged = replace(
            self.known,
            frames=max(frames, default=self.known.frames),
            notes=max(notes, default=self.known.notes),
        )
        finding = settle(self.path, self.known, acknowledged, rng, self.tally)
        self.settled(finding.digest, finding.known)
        with suppress(TimeoutError):
            while self.digests:
                self._compare(0.0)

    def _compare(self, within: float) -> None:
        told = self.follower.hear(within)
        stored = self.digests.pop(told["at"], "")
        self.tally.checks += 1
        if stored and told["digest"] != stored:
            where = f"{self.path.name}, #{told['at']}"
            self.tally.wrong.append(f"{where}: the follower holds something else than the map")


def _serve(path: Path, frame: int | None, told: Told) -> None:
    limits = Limits()
    settings = Settings(port=0, tokens=BearerTokens((("ann", TOKEN.encode()),)), limits=limits)
    with open_map(path, power_safe=True) as semantic_map:
        server = MapServer(semantic_map, settings)
        with server:
            told(server.url)
            if frame is None:
                threading.Event().wait()
            while frame is not None:
                semantic_map.apply(frame_update(frame))
                frame += 1
                told(frame)
                time.sleep(PAUSE)


def _write(url: str, notes: int, told: Told) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/sparql-update"}
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=WITHIN)
    with suppress(OSError, http.client.HTTPException):  # the server was killed
        while True:
            notes += 1
            connection.request("POST", "/sparql", note_update(notes), headers)
            answer = connection.getresponse()
            body = answer.read()
            if answer.status != 200:
                raise AssertionError(f"an update was answered {answer.status}: {body!r}")
            told(notes)
