"""Queries in worker processes: right answers, from a state of the map that is known."""

import asyncio
import csv
import io
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.query.query_files import find_query
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import (
    GraphError,
    NotAcceptableError,
    PoolBusyError,
    QueryError,
    QueryTimeoutError,
)
from kg.model.transactions import Cause
from kg.serving.opening import create_map, in_memory_map, open_map
from kg.serving.workers import process
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import Answer
from kg.serving.workers.request import WorkerCall, query_call
from tests.waiting import until

ENDLESS = "SELECT (SUM(STRLEN(STR(?a))) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i. ?j ?k ?l}"


def note(number: int) -> Quad:
    graph = v.ASSERTIONS_GRAPH
    return Quad(NamedNode(f"urn:note:{number}"), NamedNode("urn:says"), Literal(number), graph)


def write(live: SemanticMap, number: int) -> None:
    live.store.commit([], [note(number)], Cause("update"))


@pytest.fixture
def live(tmp_path: Path) -> Iterator[SemanticMap]:
    with create_map(tmp_path / "home") as opened:
        yield opened


@pytest.fixture
def pool(live: SemanticMap) -> Iterator[QueryPool]:
    with QueryPool(live, timeout=60) as made:
        yield made


def rows(pool: QueryPool, sparql: str, **options: object) -> list[list[str]]:
    answer = pool.run(sparql, accept="text/csv", **options)  # type: ignore[arg-type]
    return list(csv.reader(io.StringIO(answer.body.decode())))[1:]


def test_a_shipped_question_is_answered_as_by_the_map_itself(live: SemanticMap) -> None:
    live.update("INSERT DATA { <object/1> a here:Cup ; here:x 3.0 ; here:y 4.0 ; here:z 0.5 }")
    question = find_query("objects-within-radius")
    around = {"x": 0.0, "y": 0.0, "radius": 10.0}
    distance = question.columns.index("distance")
    with QueryPool(live, timeout=60) as pool:
        (row,) = rows(pool, question.bind(around, lambda _, text: text))
    assert float(row[distance]) == 5.0 == live.query(question.name, **around).rows[0][distance]


def test_a_format_nobody_has_is_refused_before_and_after_the_form_is_known(pool: QueryPool) -> None:
    with pytest.raises(NotAcceptableError, match="image/png"):
        pool.run("ASK {}", accept="image/png")
    with pytest.raises(NotAcceptableError, match="table or truth value"):
        pool.run("ASK {}", accept="text/turtle")
    with pytest.raises(NotAcceptableError, match="triples"):
        pool.run("DESCRIBE here:Kitchen", accept="text/csv")


def test_answers_say_which_transaction_they_saw_and_catch_up_when_told(live: SemanticMap) -> None:
    with QueryPool(live, refresh=3600) as pool:
        assert pool.run("ASK {}").sequence == 0
        for number in range(3):
            write(live, number)
        assert pool.run("ASK {}").sequence == 0
        answer = pool.run("SELECT (COUNT(*) AS ?n) {?s <urn:says> ?o}", at_least=2)
        assert answer.sequence == 3
        assert b'"3"' in answer.body


def test_a_live_map_is_followed_within_its_refresh_time(live: SemanticMap) -> None:
    with QueryPool(live, refresh=0.1) as pool:
        pool.run("ASK {}")
        write(live, 1)
        time.sleep(0.15)
        assert pool.run("ASK {}").sequence == 1


def test_maps_in_memory_and_maps_open_for_reading_are_answered_as_well(tmp_path: Path) -> None:
    with in_memory_map() as memory, QueryPool(memory) as pool:
        write(memory, 5)
        assert rows(pool, "SELECT ?n {?s <urn:says> ?n}", at_least=1) == [["5"]]
    create_map(tmp_path / "still").close()
    with open_map(tmp_path / "still", read_only=True) as still, QueryPool(still) as pool:
        assert b"true" in pool.run("ASK {here:Kitchen a ?x}").body
    assert [path.name for path in tmp_path.iterdir()] == ["still"]


def test_snapshots_live_beside_the_map_and_are_removed_with_the_pool(live, tmp_path):
    with QueryPool(live, refresh=0) as pool:
        for number in range(5):
            write(live, number)
            pool.run("ASK {}")
        (home,) = (path for path in tmp_path.iterdir() if path.name != "home")
        snapshots = [path for path in home.iterdir() if path.is_dir() and path.name != "scratch"]
        assert len(snapshots) <= 3
    assert [path.name for path in tmp_path.iterdir()] == ["home"]


def test_snapshots_of_a_killed_server_are_removed_at_the_next_start(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from kg.serving.opening import create_map\n"
        "from kg.serving.workers.pool import QueryPool\n"
        "pool = QueryPool(create_map(sys.argv[1])); pool.run('ASK {}')\n"
        "print(*pool.pids, flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    root = Path(__file__).resolve().parents[4]
    ran = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "home")],
        cwd=root, stdout=subprocess.PIPE, check=False, text=True,
    )  # fmt: skip
    assert len(list(tmp_path.glob(".home.snapshots-*"))) == 1
    with open_map(tmp_path / "home") as opened, QueryPool(opened) as pool:
        pool.run("ASK {}")
        assert len(list(tmp_path.glob(".home.snapshots-*"))) == 1
    assert not list(tmp_path.glob(".home.snapshots-*"))
    pids = ran.stdout.split()
    assert pids
    until(lambda: not any(map(_runs, pids)), "workers outlived the process that asked them")


def _runs(pid: str) -> bool:
    """Whether there is such a process; one that ended and that nobody asked after is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_many_threads_ask_at_once_and_each_gets_its_own_answer(pool: QueryPool) -> None:
    answers: dict[int, bytes] = {}

    def ask(number: int) -> None:
        answers[number] = pool.run(f"SELECT (({number} + 0) AS ?n) {{}}", accept="text/csv").body

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {n: int(body.split()[1]) for n, body in answers.items()} == {n: n for n in range(20)}


def test_a_full_queue_says_so_at_once(live: SemanticMap) -> None:
    with QueryPool(live, workers=1, queue=1, timeout=60) as pool:

        async def crowd() -> list[object]:
            asked = [
                pool.answer_async(query_call(ENDLESS, timeout=0.7)),
                pool.answer_async(query_call("ASK {}")),
                pool.answer_async(query_call("ASK {}")),
            ]
            return await asyncio.gather(*asked, return_exceptions=True)

        first, second, third = asyncio.run(crowd())
        assert isinstance(first, QueryTimeoutError)
        assert not isinstance(second, QueryError)
        assert isinstance(third, PoolBusyError)
        assert pool.run("ASK {}")


def test_a_cancelled_query_is_killed_and_its_worker_free_again(live: SemanticMap) -> None:
    with QueryPool(live, workers=1, timeout=60) as pool:

        async def give_up() -> None:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(pool.answer_async(query_call(ENDLESS)), 0.3)
            assert (await pool.answer_async(query_call("ASK {}"))).body

        asyncio.run(give_up())


def test_a_shorter_time_limit_holds_and_a_longer_one_is_cut(live: SemanticMap) -> None:
    with QueryPool(live, workers=1, timeout=0.4) as pool:
        for timeout in (0.1, 1000.0):
            with pytest.raises(QueryTimeoutError, match="time limit"):
                pool.run(ENDLESS, timeout=timeout)


def test_a_slow_start_of_a_worker_is_not_taken_off_a_querys_time(live, monkeypatch):
    monkeypatch.setattr(process, "_START", f"import time; time.sleep(3); {process._START}")
    with QueryPool(live, workers=1) as pool:
        assert pool.run("ASK {}", timeout=2).body


def test_a_closed_pool_says_it_is_closed(live: SemanticMap) -> None:
    pool = QueryPool(live)
    pool.close()
    pool.close()
    with pytest.raises(GraphError, match="closed"):
        pool.run("ASK {}")


def test_closing_ends_queries_that_still_run(live: SemanticMap) -> None:
    pool = QueryPool(live, timeout=60)
    raised: list[BaseException] = []

    def ask() -> None:
        try:
            pool.run(ENDLESS)
        except (GraphError, QueryError) as error:
            raised.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    until(lambda: pool.busy)
    pool.close()
    thread.join()
    assert len(raised) == 1


def test_a_turn_in_the_past_is_given_back_and_not_waited_for_for_ever(pool: QueryPool) -> None:
    for _ in range(3):
        with pytest.raises(QueryError, match="did you mean SELECT"):
            pool.run("SELEKT", at=0)
    assert b"true" in pool.run("ASK {}", at=0).body


def test_the_state_of_the_map_waits_for_a_busy_processor_and_a_query_does_not(live):
    state = {"base": live.base, "objects": True, "surface": 0}
    with QueryPool(live, workers=1, timeout=0.5) as pool:

        def held(call: WorkerCall) -> Answer:
            """The answer of a worker that gets no processor for longer than the time limit."""
            pool.run("ASK {}")  # it has started
            (worker,) = pool.pids
            os.kill(worker, signal.SIGSTOP)
            freed = threading.Timer(1.5, goes_on, (worker,))
            freed.start()
            try:
                return pool.answer(call)
            finally:
                freed.join()

        def goes_on(worker: int) -> None:
            with suppress(ProcessLookupError):  # at its time limit it was ended
                os.kill(worker, signal.SIGCONT)

        assert b'"objects"' in held(WorkerCall(b"V", state)).body
        with pytest.raises(QueryTimeoutError):
            held(query_call("ASK {}"))
