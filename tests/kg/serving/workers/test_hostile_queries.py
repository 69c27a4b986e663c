"""Hostile queries: each ends at a limit, the pool answers on, and nothing is left behind."""

import contextlib
import gc
import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import QueryError, QueryRefusedError, QueryTimeoutError, QueryTooLargeError
from kg.model.transactions import Cause
from kg.serving.opening import create_map
from kg.serving.workers.pool import QueryPool
from tests.waiting import until

CARTESIAN = "SELECT (SUM(STRLEN(STR(?a))) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i. ?j ?k ?l}"
LIMIT = 0.8  # [s] of a query that is to be cut off
PATIENT = 60.0  # [s] of all others, on a machine however slow


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SemanticMap]:
    graph, link = v.ASSERTIONS_GRAPH, NamedNode("urn:link")
    with create_map(tmp_path_factory.mktemp("hostile") / "home") as opened:
        gc.collect()  # what earlier tests left is not let go of while ours are counted
        nodes = [NamedNode(f"urn:node:{number}") for number in range(60)]
        links = [Quad(a, link, b, graph) for a in nodes for b in nodes if a != b]
        huge = Quad(NamedNode("urn:huge"), NamedNode("urn:text"), Literal("a" * 3_000_000), graph)
        opened.store.native.add(huge)  # beyond what a writer takes
        opened.store.commit([], links, Cause("update"))
        yield opened


@pytest.fixture(scope="module")
def pool(live: SemanticMap) -> Iterator[QueryPool]:
    with QueryPool(live, timeout=PATIENT, memory_mb=512, max_result_bytes=1 << 20) as made:
        yield made


def answers(pool: QueryPool) -> bool:
    return b"true" in pool.run("ASK {here:Kitchen a ?x}").body


def children() -> set[int]:
    return {
        int(stat.parent.name)
        for stat in Path("/proc").glob("[0-9]*/stat")
        if _parent(stat) == os.getpid()
    }


def _parent(stat: Path) -> int | None:
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return None  # ended meanwhile


def descriptors() -> int:
    """Those open here, but for the engine's own files, which come and go with its flushes."""
    count = 0
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            count += "hostile" not in str(link.readlink())
    return count


@pytest.fixture(autouse=True, scope="module")
def _nothing_is_left(pool: QueryPool, live: SemanticMap) -> Iterator[None]:
    def runs() -> bool:  # one that was ended is replaced a moment later
        return 1 <= len(pool.pids) <= 3 and children() >= set(pool.pids)

    def processes() -> int:  # beside the workers
        return len(children() - set(pool.pids))

    def files() -> int:  # beside the workers' three each
        return descriptors() - 3 * len(pool.pids)

    assert answers(pool)
    until(runs)
    before = processes(), files()
    yield
    assert answers(pool)
    until(runs)
    until(lambda: processes() <= before[0], "a process is left", 20)
    until(lambda: files() <= before[1], "a file is left", 20)
    beside = [path for path in Path(live.store.where).parent.iterdir() if path.name != "home"]
    assert len(beside) == 1
    assert len([path for path in beside[0].iterdir() if path.is_dir()]) <= 3


@pytest.mark.parametrize(
    "sparql",
    [
        "",
        "ASK {",
        "SELECT * {?s ?p }",
        "ASK {FILTER(1 + )}",
        "ASK {?s ?p 'a\x00b",
        "ASK {<http://\x00> ?p ?o}",
        "PREFIX x: <nowhere> ASK {x:y ?p ?o}",
        "ASK {<" + "a" * 100_000 + "> ?p ?o}",
        "ASK {FILTER(<urn:function>(1, 2) &&)}",
        "SELECT (COUNT(COUNT(?x)) AS ?n {}",
    ],
)
def test_malformed_queries_are_one_line_errors(pool: QueryPool, sparql: str) -> None:
    with pytest.raises(QueryError) as caught:
        pool.run(sparql)
    assert "\n" not in str(caught.value)
    assert not isinstance(caught.value, QueryTimeoutError)


@pytest.mark.parametrize("text", ["ASK {?s ?p '\ud800'}", "\udfff"])
def test_lone_surrogates_are_no_text(pool: QueryPool, text: str) -> None:
    with pytest.raises(QueryError, match="surrogate"):
        pool.run(text)


WORDS = """
    SELECT * ASK { } ( ) [ ] ?s ?p $x <urn:a> here:Kitchen 'a' ''' # . ; , / | ^ * + ? ! FILTER
    OPTIONAL UNION MINUS GRAPH BIND AS VALUES EXISTS NOT 1 -1 1e9 true << >> a \\u0041 ORDER BY
    GROUP HAVING LIMIT OFFSET DESCRIBE CONSTRUCT WHERE REGEX SUM COUNT DISTINCT FROM NAMED PREFIX
    SERVICE LOAD \x00 \x7f \xe9 \U0001d54a """
PIECES = st.sampled_from([*WORDS.split(), "\n"])


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.lists(PIECES, max_size=25).map(" ".join) | st.text(max_size=80))
def test_garbage_is_answered_or_refused(pool: QueryPool, sparql: str) -> None:
    try:
        assert pool.run(sparql, timeout=LIMIT).media_type
    except QueryError as error:
        assert "\n" not in str(error)
        assert "ended from outside" not in str(error)


@pytest.mark.parametrize(
    "sparql",
    [
        "SELECT * {" * 15_000 + "}" * 15_000,
        "ASK {FILTER(" + "(" * 50_000 + "1" + ")" * 50_000 + ")}",
        "ASK {" + "FILTER NOT EXISTS {" * 5_000 + "}" * 5_000 + "}",
        "ASK {?s " + "(" * 30_000 + "<urn:p>" + ")*" * 30_000 + " ?o}",
        "ASK {?s ?p " + "[<urn:p> " * 9_000 + "1" + "]" * 9_000 + "}",
        "{" * 199_999,
    ],
)
def test_deep_nesting_is_refused_before_the_parser(pool: QueryPool, sparql: str) -> None:
    with pytest.raises(QueryRefusedError, match="nest"):
        pool.run(sparql)


@pytest.mark.parametrize(
    "sparql",
    [
        "ASK {FILTER(" + "!" * 150_000 + "true)}",
        "ASK {FILTER(true" + " || false" * 20_000 + ")}",
        "ASK {FILTER(0" + " - 1" * 40_000 + ")}",
        "ASK {" + "{} UNION " * 20_000 + "{}}",
        "ASK {" + "OPTIONAL {?s ?p ?o} " * 9_000 + "}",
        "ASK {?s <urn:link>" + "/<urn:link>" * 5_000 + " ?o}",
        "ASK {?s " + "^" * 150_000 + "<urn:link> ?o}",
        "ASK {" + "?s ?p ?o . " * 15_000 + "}",
        "ASK {" + "<< ?s ?p " * 2_000 + "?o" + " >>" * 2_000 + " ?p ?o}",
        "ASK {FILTER(?x<" + "a." * 90_000 + ")}",
        "service#" * 20_000,
    ],
    ids=lambda sparql: sparql[:30],
)
def test_long_chains_that_brackets_do_not_show_end_at_a_limit(pool: QueryPool, sparql: str) -> None:
    try:
        assert pool.run(sparql, timeout=LIMIT).body
    except QueryError as error:
        assert "ended from outside" not in str(error)


class Bomb(threading.Thread):
    """A query without an end, asked on a thread of its own; `error` is how it ended."""

    def __init__(self, pool: QueryPool, seconds: float) -> None:
        super().__init__()
        self.error: QueryError | None = None
        self._pool, self._seconds = pool, seconds

    def run(self) -> None:
        try:
            self._pool.run(CARTESIAN, timeout=self._seconds)
        except QueryError as error:
            self.error = error


def wait_until_busy(pool: QueryPool, asking: list[threading.Thread]) -> None:
    """Waits until each of those threads has a worker, or some are through already."""
    while pool.busy < len(asking) and all(thread.is_alive() for thread in asking):
        time.sleep(0.005)


def test_bombs_on_every_worker_end_and_the_next_query_is_answered(pool: QueryPool) -> None:
    bombs = [Bomb(pool, LIMIT) for _ in range(2)]
    for bomb in bombs:
        bomb.start()
    wait_until_busy(pool, [*bombs])
    assert answers(pool)
    for bomb in bombs:
        bomb.join()
    assert [type(bomb.error) for bomb in bombs] == [QueryTimeoutError] * 2


def test_huge_results_are_cut_with_an_error(live: SemanticMap) -> None:
    with QueryPool(live, timeout=PATIENT, max_result_bytes=1 << 20) as patient:
        for sparql in (
            "SELECT * {?s ?p ?o}",
            "SELECT (REPLACE(?x, 'a', 'bbbb') AS ?y) {<urn:huge> <urn:text> ?x}",
            "CONSTRUCT {?s ?p ?x} {<urn:huge> <urn:text> ?x. ?s ?p ?o}",
            "DESCRIBE <urn:huge>",
        ):
            with pytest.raises(QueryTooLargeError, match=re.escape("1,048,576 bytes")):
                patient.run(sparql)
            assert answers(patient)


def test_a_huge_literal_grown_in_memory_ends_at_the_limit_of_memory(live: SemanticMap) -> None:
    grow = "BIND(CONCAT(?x0, ?x0, ?x0, ?x0) AS ?x1) " + " ".join(
        f"BIND(CONCAT(?x{n}, ?x{n}, ?x{n}, ?x{n}) AS ?x{n + 1})" for n in range(1, 8)
    )
    sparql = f"SELECT (STRLEN(?x8) AS ?n) {{<urn:huge> <urn:text> ?x0 {grow}}}"
    with QueryPool(live, timeout=PATIENT, memory_mb=512) as patient:
        with pytest.raises(QueryTooLargeError, match="512 MB"):
            patient.run(sparql)
        with pytest.raises(QueryTooLargeError, match="512 MB"):
            patient.run("SELECT * {?a ?b ?c. ?d ?e ?f. ?g ?h ?i} ORDER BY ?c ?f ?i")
        assert answers(patient)


@pytest.mark.parametrize(
    "sparql",
    [
        "ASK {<urn:huge> <urn:text> ?x FILTER REGEX(?x, '(a+)+$b')}",
        "ASK {<urn:huge> <urn:text> ?x FILTER REGEX(?x, '((((a{1,99}){1,99}){1,99}){1,99})b')}",
        "ASK {?s ?p ?x FILTER REGEX(STR(?x), '(.*.*.*.*.*.*)*z{9}')}",
        "ASK {?s <urn:link>+/<urn:link>+/<urn:link>+/<urn:link>+ <urn:nowhere>}",
        "SELECT (COUNT(*) AS ?n) {?a (<urn:link>*/<urn:link>*)* ?b. ?b (<urn:link>|!<urn:x>)+ ?c}",
        "SELECT (COUNT(*) AS ?n) {?a (!<urn:x>)* ?b. ?b (!<urn:x>)* ?c. ?c (!<urn:x>)* ?d}",
    ],
)
def test_regex_and_path_explosions_end(pool: QueryPool, sparql: str) -> None:
    try:
        assert pool.run(sparql, timeout=LIMIT).body
    except (QueryTimeoutError, QueryTooLargeError) as error:
        assert "limit" in str(error) or "memory" in str(error)


def test_a_query_longer_than_allowed_never_reaches_a_worker(pool: QueryPool) -> None:
    with pytest.raises(QueryRefusedError, match="200,000 characters"):
        pool.run("ASK {} #" + "x" * 200_000)


def test_a_worker_killed_between_queries_is_replaced(pool: QueryPool) -> None:
    for _ in range(2):
        for pid in pool.pids:
            os.kill(pid, signal.SIGKILL)
        asked = [threading.Thread(target=answers, args=(pool,)) for _ in range(8)]
        for thread in asked:
            thread.start()
        for thread in asked:
            thread.join()
        assert answers(pool)
    assert all(_running(pid) for pid in pool.pids)


def _running(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_worker_killed_during_a_query_costs_nobody_the_answer(live: SemanticMap) -> None:
    slow = (
        "SELECT (COUNT(*) AS ?n) {<urn:node:1> <urn:link> ?b. ?b <urn:link> ?c. ?c <urn:link> ?d}"
    )
    with QueryPool(live, workers=1, timeout=60) as patient:
        expected = patient.run(slow).body
        got: list[bytes] = []
        thread = threading.Thread(target=lambda: got.append(patient.run(slow).body))
        (pid,) = patient.pids
        thread.start()
        wait_until_busy(patient, [thread])
        os.kill(pid, signal.SIGKILL)
        thread.join()
        assert got == [expected]
        assert answers(patient)


def test_a_stopped_worker_ends_at_the_time_limit(live: SemanticMap) -> None:
    with QueryPool(live, workers=1, timeout=PATIENT) as patient:
        answers(patient)
        os.kill(patient.pids[0], signal.SIGSTOP)
        with pytest.raises(QueryTimeoutError):
            patient.run("ASK {}", timeout=LIMIT)
        assert answers(patient)


def test_an_orphaned_bomb_ends_by_itself(live: SemanticMap) -> None:
    """The worker's own alarm, with nobody watching."""
    with QueryPool(live, workers=1, timeout=PATIENT) as patient:
        answers(patient)
        worker = patient._workers._idle[-1]
        worker._wait = lambda *_: None  # type: ignore[method-assign]
        with pytest.raises(QueryTimeoutError):
            patient.run(CARTESIAN, timeout=LIMIT)
        assert answers(patient)


def test_hundreds_of_queries_leave_no_trace(pool: QueryPool, live: SemanticMap) -> None:
    graph = v.ASSERTIONS_GRAPH
    for number in range(300):
        if number % 50 == 0:
            fact = Quad(NamedNode("urn:loop"), NamedNode("urn:at"), Literal(number), graph)
            live.store.commit([], [fact], Cause("update"))
        if number % 3:
            assert answers(pool)
        else:
            with pytest.raises(QueryError):
                pool.run("ASK {SERVICE <http://127.0.0.1:9/> {}}" if number % 2 else "ASK {{")
