"""Query workers killed in the middle of queries, while the map goes on being written.

An answer is right or there is none: each query reads how often the objects were seen, which is the
same number for all of them in every whole frame, and the number of the transaction that it saw.
"""

from __future__ import annotations

import json
import os
import random
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.kills.examination import Known, examine
from benchmarks.kills.frames import BASE, OBJECTS, frame_update
from benchmarks.kills.processes import Child
from benchmarks.kills.tally import Tally
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HereaboutsError
from kg.serving.opening import create_map
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import Answer, WorkerDiedError

MAX_DELAY = 0.6  # [s] from one kill to the next
WORKERS = 2
WITHIN = 120.0  # [s] in which the pool must be whole again
#: Counts of observations by object, after as many joins as take a worker some tens of milliseconds.
LONG = (
    "SELECT ?o ?n (COUNT(*) AS ?m) { ?o here:observationCount ?n . ?a here:isA ?b . "
    "?c here:isA here:Chair FILTER(STRLEN(STR(?a)) != STRLEN(STR(?c))) } GROUP BY ?o ?n"
)
Told = Callable[[Any], None]


def kill_workers(
    folder: Path, kills: int, rng: random.Random, on_kill: Callable[[], None]
) -> Tally:
    """So many kills at moments drawn from `rng`, under one pool."""
    tally = Tally("query worker")
    path = folder / "worker.map"
    seed = rng.random()
    child = Child(lambda told: _Asked(path, random.Random(seed), told).run(kills))
    for message in child.rest():
        if message == "kill":
            tally.kills += 1
            on_kill()
        elif isinstance(message, dict):
            tally.acknowledged, tally.checks = message["frames"], message["answers"]
            tally.notes = [f"{message['died']} of {message['answers']:,} queries refused"]
        else:
            tally.wrong.append(message)
    if child.end() != 0:
        tally.wrong.append("the process that asks ended; its traceback is above")
    child.close()
    return tally


class _Asked:
    """A map being written and asked, in one process whose workers are killed."""

    def __init__(self, path: Path, rng: random.Random, told: Told) -> None:
        self._path, self._rng, self._told = path, rng, told
        self._over = threading.Event()
        self._guard = threading.Lock()
        self._frames = self._answers = self._died = 0

    def run(self, kills: int) -> None:
        """Kill so many workers, then look at the map."""
        with create_map(self._path, base=BASE) as semantic_map:
            self._write_one(semantic_map)
            with QueryPool(semantic_map, workers=WORKERS, timeout=WITHIN, refresh=0.2) as pool:
                threads = [
                    threading.Thread(target=self._write, args=(semantic_map,)),
                    *(threading.Thread(target=self._ask, args=(pool,)) for _ in range(WORKERS)),
                ]
                for thread in threads:
                    thread.start()
                for _ in range(kills):
                    self._kill(pool)
                self._over.set()
                for thread in threads:
                    thread.join()
                self._whole(pool)
        known = Known(self._frames, 0, self._frames)
        for line in examine(self._path, Known(), known, read_only=False).wrong:
            self._told(line)
        self._told({"frames": self._frames, "answers": self._answers, "died": self._died})

    def _kill(self, pool: QueryPool) -> None:
        time.sleep(self._rng.uniform(0.0, MAX_DELAY))
        end = time.monotonic() + WITHIN
        while time.monotonic() < end:
            if pids := pool.pids:
                with suppress(ProcessLookupError):
                    os.kill(self._rng.choice(pids), signal.SIGKILL)
                    self._told("kill")
                    return
            time.sleep(0.001)
        self._told(f"the pool had no worker for {WITHIN:g} s")

    def _whole(self, pool: QueryPool) -> None:
        """A worker is back, and answers; there are no more than there may be."""
        end = time.monotonic() + WITHIN
        while not pool.pids and time.monotonic() < end:
            pool.run("ASK {}")
            time.sleep(0.01)
        if not 1 <= len(pool.pids) <= WORKERS:
            self._told(f"the pool has {len(pool.pids)} of {WORKERS} workers")

    def _write(self, semantic_map: SemanticMap) -> None:
        while not self._over.wait(0.02):
            self._write_one(semantic_map)

    def _write_one(self, semantic_map: SemanticMap) -> None:
        semantic_map.apply(frame_update(self._frames))
        self._frames += 1

    def _ask(self, pool: QueryPool) -> None:
        while not self._over.is_set():
            told = self._frames
            try:
                answer = pool.run(LONG, at_least=told)
            except WorkerDiedError:  # killed twice, once on each worker
                with self._guard:
                    self._answers, self._died = self._answers + 1, self._died + 1
            except HereaboutsError as error:
                self._told(f"a query failed otherwise: {error}")
            else:
                with self._guard:
                    self._answers += 1
                if line := _wrong(answer, told):
                    self._told(line)


def _wrong(answer: Answer, told: int) -> str:
    """Error of an answer that must include `told` frames."""
    rows = json.loads(answer.body)["results"]["bindings"]
    seen = {int(row["n"]["value"]) for row in rows}
    if len(rows) != OBJECTS - 1 or seen != {answer.sequence} or answer.sequence < told:
        return f"{len(rows)} rows of frames {seen} at #{answer.sequence}, asked after #{told}"
    return ""
