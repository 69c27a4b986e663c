"""Compaction and durability of the history."""

import random
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from kg.history.storage import log as log_module
from kg.history.storage import maintenance
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import GraphError, HistoryError
from kg.model.records import Evidence, MapUpdate, ObjectRecord, RecordingRecord, RobotRecord
from kg.serving.opening import open_map
from tests.waiting import program, told_until_killed

Written = Callable[[int], SemanticMap]

# things come and go, and the past is dropped, for ever
_CHURN = """
import sys
from kg.serving.opening import open_map
semantic_map = open_map(sys.argv[1])
n = semantic_map.sequence
while True:
    thing = f"<thing/{n}>"
    semantic_map.update(f"INSERT DATA {{ {thing} a here:Cup ; here:x 1 ; here:y 1 }}")
    semantic_map.update(f"DELETE WHERE {{ {thing} ?p ?o }}")
    semantic_map.history.compact(keep=0.0)
    print(semantic_map.sequence, flush=True)
    n += 1
"""


def test_the_past_before_the_edge_goes_and_the_rest_stays(written, frame, monkeypatch):
    with monkeypatch.context() as clock:
        ago = time.time() - 3600
        clock.setattr(time, "time", lambda: ago)
        clock.setattr(time, "time_ns", lambda: int(ago * 1e9))
        long_ago = written(20)
    with long_ago as semantic_map:
        for number in range(20, 25):
            semantic_map.apply(frame(number, removed=(semantic_map.base + "object/2",)))
        later = {n: set(semantic_map.at(n).engine) for n in range(20, 26)}
        now = set(semantic_map.engine)
        before, after = (change.time for change in list(semantic_map.history.changes())[19:21])
        done = semantic_map.history.compact(keep=time.time() - (before + after) / 2)
        assert semantic_map.history.state_of(semantic_map.base + "object/2", 25) == ()
        assert (done.floor, done.dropped) == (20, 20)
        assert done.bytes_after < done.bytes_before
        assert set(semantic_map.engine) == now
        for number, facts in later.items():
            assert set(semantic_map.at(number).engine) == facts
        kept = [change.sequence for change in semantic_map.history.changes(20)]
        assert kept == [*range(21, 26)]
        with pytest.raises(HistoryError, match="there are #20 to #25"):
            semantic_map.at(19)
        assert (
            "before the history begins"
            in semantic_map.history.explain("object/1 here:firstSeen")[0].because[-1].text
        )


def test_a_compacted_map_goes_on(written: Written, frame: Callable[..., MapUpdate]) -> None:
    with written(10) as semantic_map:
        path = semantic_map.store.where
        first = set(semantic_map.at(1).engine)
        assert semantic_map.history.compact().dropped == 0  # packing alone keeps all of the past
        assert set(semantic_map.at(1).engine) == first
        semantic_map.history.compact(keep=0.0)
    with open_map(path) as semantic_map:
        for number in range(10, 30):
            semantic_map.apply(frame(number))
        with semantic_map.at(semantic_map.sequence) as now:
            assert set(now.engine) == set(semantic_map.engine)
        with semantic_map.at(25) as then:
            assert {record.observations for record in then.objects()} == {25}


def test_a_reader_cannot_compact_or_retain(written: Written) -> None:
    with written(1) as semantic_map:
        path = semantic_map.store.where
    with (
        open_map(path, read_only=True) as semantic_map,
        pytest.raises(GraphError, match="reading only"),
    ):
        semantic_map.history.compact(keep=0.0)
    with open_map(path, read_only=True) as reader, pytest.raises(GraphError, match="reading only"):
        reader.history.retain(60)
    with open_map(path) as writer, pytest.raises(HistoryError, match="0 s or longer"):
        writer.history.retain(-1)


def test_an_observation_costs_less_than_150_bytes(written: Written) -> None:
    """Ten objects a frame, a fifth of the sightings the best so far; all of the file counts."""
    with written(1) as semantic_map:
        for number in range(1, 100):
            semantic_map.apply(_ten_objects(semantic_map.base, number))
        done = semantic_map.history.compact()
    assert done.bytes_after / (10 * 100) < 150


def _ten_objects(base: str, number: int) -> MapUpdate:
    best = number - number % 5
    return MapUpdate(
        objects=tuple(
            ObjectRecord(
                iri=f"{base}object/{index}",
                category=v.HERE + "Chair",
                p_map=np.array([index + 0.07 * (number * index % 3), 1.0, 0.5]),
                confidence=0.01 * (number * index % 300),
                existence=0.01 * (number * index % 100),
                observations=number,
                first_seen=1e9,
                last_seen=1e9 + number,
                evidence=Evidence(
                    f"frame-{best:06d}", "flat", 1e9 + best, (1.0, best, 3.0, 4.0), 0.5, "deimv2"
                ),
            )
            for index in range(1, 11)
        ),
        robot=RobotRecord(np.array([0.1 * number, 0.0, 1.2]), 0.5, 1e9 + number),
        recording=RecordingRecord("flat", number, f"frame-{number:06d}", np.eye(4)),
    )


def test_a_map_that_runs_forgets_what_is_older_than_it_is_told_to_keep(written, frame, monkeypatch):
    monkeypatch.setattr(maintenance, "TRIM_WITHIN", 0)  # a little at each flush
    with written(30) as semantic_map:
        path, now = semantic_map.store.where, set(semantic_map.engine)
        semantic_map.history.retain(0)
        while semantic_map.history.log.floor < 30:
            semantic_map.store.flush()
        left = [commit.sequence for commit in semantic_map.history.log.commits(0, 30)]
        assert 0 < len(left) < 30, "the rest goes at the next flushes"
        with pytest.raises(HistoryError, match="there are #30 to #30"):
            semantic_map.at(29)
        with pytest.raises(HistoryError, match="not kept"):
            list(semantic_map.history.changes(29))
    with open_map(path) as semantic_map:  # whole, although it ended midway
        with semantic_map.at(30) as then:
            assert set(then.engine) == now
        semantic_map.history.retain(0)
        sizes = []
        for number in range(30, 60):
            semantic_map.apply(frame(number))
            while [*semantic_map.history.log.commits(0, number)]:
                semantic_map.store.flush()
            sizes.append(semantic_map.history.log.db.execute("PRAGMA page_count").fetchone()[0])
        assert sizes[-1] <= sizes[9], "what is dropped is written anew"
        semantic_map.history.retain(3600)
        semantic_map.apply(frame(60))
        with semantic_map.at(60) as then:
            before = set(then.engine)
        semantic_map.apply(frame(61))
        with semantic_map.at(60) as then:
            assert set(then.engine) == before
        assert semantic_map.history.compact().dropped == 0


def test_subjects_without_changes_leave_the_history(written: Written) -> None:
    with written(1) as semantic_map:
        for number in range(20):
            semantic_map.update(f"INSERT DATA {{ <thing/{number}> rdfs:label 'cup' }}")
            semantic_map.update(f"DELETE WHERE {{ <thing/{number}> ?p ?o }}")
        log = semantic_map.history.log
        assert len(log.subjects_under(semantic_map.base + "thing/")) == 20
        semantic_map.history.compact(keep=0.0)
        assert log.subjects_under(semantic_map.base) == []
        semantic_map.update("INSERT DATA { <thing/3> rdfs:label 'pot' }")
        entries = semantic_map.history.events(f"<{semantic_map.base}thing/3>")
        assert [entry.words for entry in entries] == ["label pot"]


def test_killed_at_any_moment_a_map_that_forgets_loses_nothing_else(written, tmp_path):
    written(1).close()
    path, rng = tmp_path / "flat.map", random.Random(11)
    for _ in range(2):
        acknowledged = told_until_killed(program(_CHURN, path), rng)
        with open_map(path) as semantic_map:
            assert semantic_map.sequence >= acknowledged
            with semantic_map.at(semantic_map.sequence) as now:
                assert set(now.engine) == set(semantic_map.engine)


def test_several_that_flush_at_once_while_the_map_is_written(written, frame, monkeypatch):
    monkeypatch.setattr(log_module, "KEY_FRAME_AFTER", 0)
    with written(5) as semantic_map:
        semantic_map.history.retain(0.05)

        def flush() -> None:
            for _ in range(5):
                semantic_map.store.flush()

        threads = [threading.Thread(target=flush) for _ in range(4)]
        for thread in threads:
            thread.start()
        for number in range(5, 30):
            semantic_map.apply(frame(number))
            if number % 6 == 0:
                with semantic_map.at(semantic_map.sequence) as now:
                    assert set(now.engine) == set(semantic_map.engine)
        for thread in threads:
            thread.join()
