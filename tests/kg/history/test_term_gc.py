"""Terms that nothing refers to leave the history; every term that is used stays, whatever ends."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from kg.history.storage import compaction
from kg.history.storage.log import HistoryLog
from kg.history.storage.row_codec import INTERNED, decode_delta
from kg.history.storage.term_dictionary import KEPT
from kg.history.storage.term_gc import Pruning, prune
from kg.maps.semantic_map import SemanticMap
from kg.opening import open_map

ROOT = Path(__file__).resolve().parents[3]
Written = Callable[[int], SemanticMap]

# things come and go, and what they leave behind is pruned, for ever
_CHURN = """
import sys
from kg.opening import open_map
semantic_map = open_map(sys.argv[1])
n = semantic_map.sequence
while True:
    thing = f"<thing/{n}>"
    semantic_map.update(f"INSERT DATA {{ {thing} a here:Cup ; here:x 1 ; here:y 1 }}")
    semantic_map.update(f"DELETE WHERE {{ {thing} ?p ?o }}")
    semantic_map.compact(keep=0.0)
    print(semantic_map.sequence, flush=True)
    n += 1
"""


def held(log: HistoryLog) -> set[int]:
    with log.lock:
        return {row[0] for row in log.db.execute("SELECT id FROM term WHERE id > ?", (KEPT,))}


def used(log: HistoryLog) -> set[int]:
    """Numbers of the terms that some row refers to, found the slow way."""
    found: set[int] = set()
    with log.lock:
        for row in log.db.execute("SELECT subject, graph FROM node"):
            found.update(row)
        for table in ("change", "state"):
            for (data,) in log.db.execute(f"SELECT data FROM {table}"):
                delta = decode_delta(data)
                for coded in (*delta.removed, *delta.added):
                    found.add(coded.predicate)
                    if coded.kind == INTERNED:
                        found.add(int(coded.value))
    return {number for number in found if number > KEPT}


def come_and_go(semantic_map: SemanticMap, number: int) -> None:
    thing = f"<thing/{number}>"
    semantic_map.update(f"INSERT DATA {{ {thing} a here:Cup ; here:x 1 ; here:y 1 }}")
    semantic_map.update(f"DELETE WHERE {{ {thing} ?p ?o }}")


def with_unused_terms(semantic_map: SemanticMap) -> HistoryLog:
    """A history that was dropped, and the terms of ten things with it unused."""
    log = semantic_map.history
    for number in range(10):
        come_and_go(semantic_map, number)
    compaction._raise_floor(log, 0.0)
    while compaction._drop_some(log)[0]:
        pass
    return log


def test_compaction_drops_the_terms_that_nothing_refers_to(written: Written) -> None:
    with written(5) as semantic_map:
        log = semantic_map.history
        for number in range(20):
            come_and_go(semantic_map, number)
        assert held(log) == used(log)
        assert semantic_map.compact().dropped == 0
        assert held(log) == used(log), "all of the past is kept, and all of it is used"
        before, now = len(held(log)), set(semantic_map.engine)
        semantic_map.compact(keep=0.0)
        assert held(log) == used(log)
        assert len(held(log)) <= before - 20
        come_and_go(semantic_map, 3)  # terms that were dropped come back under new numbers
        with semantic_map.at(semantic_map.sequence) as then:
            assert set(then.engine) == set(semantic_map.engine)
        assert {q for q in semantic_map.engine if "sequence" not in q.predicate.value} == {
            q for q in now if "sequence" not in q.predicate.value
        }


def test_terms_that_are_used_again_meanwhile_stay(written: Written) -> None:
    with written(3) as semantic_map:
        log = with_unused_terms(semantic_map)
        unused = held(log) - used(log)
        assert len(unused) >= 10
        pruning, steps = Pruning(log), 0
        while pruning.step() is not None:
            come_and_go(semantic_map, steps % 10)
            steps += 1
        assert steps >= 5
        assert used(log) <= held(log)
        with semantic_map.at(semantic_map.sequence) as then:
            assert set(then.engine) == set(semantic_map.engine)
        prune(log)
        assert held(log) == used(log)


def test_two_searches_at_once_do_not_deceive_each_other(written: Written) -> None:
    with written(3) as semantic_map:
        log = with_unused_terms(semantic_map)
        first = Pruning(log)
        first.step()
        second = Pruning(log)
        while second.step() is not None:
            pass
        come_and_go(semantic_map, 4)
        while first.step() is not None:
            pass
        assert used(log) <= held(log)


def test_a_map_that_forgets_as_it_runs_forgets_terms_too(
    written: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compaction, "WORTH_PRUNING", 5)
    with written(1) as semantic_map:
        log = semantic_map.history
        semantic_map.retain(0)
        most = []
        for number in range(30):
            come_and_go(semantic_map, number)
            while log.floor < semantic_map.sequence or [*log.commits(0, log.floor)]:
                semantic_map.store.flush()
            most.append(len(held(log)))
        assert used(log) <= held(log)
        assert most[-1] < most[0] + 22, "of 30 things that came and went, most are forgotten"


def test_killed_at_any_moment_no_used_term_is_lost(written: Written, tmp_path: Path) -> None:
    written(1).close()
    path, rng = tmp_path / "flat.map", random.Random(11)
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-c", _CHURN, str(path)],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None and process.stderr is not None
        acknowledged = int(process.stdout.readline())
        time.sleep(rng.uniform(0.0, 0.1))
        process.kill()
        acknowledged = max([acknowledged, *map(int, process.stdout.read().split("\n")[:-1])])
        assert process.wait() == -signal.SIGKILL, process.stderr.read()
        process.stdout.close()
        process.stderr.close()
        with open_map(path) as semantic_map:
            assert semantic_map.sequence >= acknowledged
            assert used(semantic_map.history) <= held(semantic_map.history)
            with semantic_map.at(semantic_map.sequence) as now:
                assert set(now.engine) == set(semantic_map.engine)


def test_two_that_flush_at_once_search_one_after_the_other(
    written: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compaction, "WORTH_PRUNING", 1)
    go_on, searching, most = Pruning.step, list[int](), list[int]()
    failed: list[ValueError] = []

    def step(pruning: Pruning) -> int | None:
        searching.append(0)
        most.append(len(searching))
        time.sleep(0.002)  # for the others to come
        try:
            return go_on(pruning)
        finally:
            searching.pop()

    monkeypatch.setattr(Pruning, "step", step)
    with written(1) as semantic_map:
        semantic_map.retain(0)
        for number in range(5):
            come_and_go(semantic_map, number)

        def flush() -> None:
            try:
                for _ in range(5):
                    semantic_map.store.flush()
            except ValueError as error:
                failed.append(error)

        threads = [threading.Thread(target=flush) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert used(semantic_map.history) <= held(semantic_map.history)
    assert failed == []
    assert max(most) == 1
