"""Killed between log and store, out of step, copied back: nothing acknowledged is lost."""

import random
import shutil
import signal
import sqlite3
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from pyoxigraph import Quad

from kg.history.storage.maintenance import FILE
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, HistoryError
from kg.serving.opening import create_map, open_map
from kg.store.transactional import TransactionalStore
from tests.kg.conftest import BASE, frame_update
from tests.waiting import program, told_until_killed

CONFTEST = str(Path(__file__).parent.with_name("conftest.py"))
Written = Callable[[int], SemanticMap]

# writes frames for ever, and says of each when it is acknowledged
_WRITER = """
import importlib.util, os, sys
spec = importlib.util.spec_from_file_location("writing", sys.argv[2])
writing = importlib.util.module_from_spec(spec); spec.loader.exec_module(writing)
from kg.serving.opening import open_map
from kg.store.transactional import TransactionalStore
semantic_map = open_map(sys.argv[1], power_safe="safe" in sys.argv)
if "between" in sys.argv:  # the log has the frame, the store will never hear of it
    TransactionalStore._write = lambda *_: os.kill(os.getpid(), 9)
frame = semantic_map.sequence
while True:
    semantic_map.apply(writing.frame_update(frame))
    print(semantic_map.sequence, flush=True)
    frame += 1
"""


def _facts(semantic_map: SemanticMap) -> set[Quad]:
    return set(semantic_map.engine)


def _agrees(semantic_map: SemanticMap) -> None:
    """Log and store say the same, and the store holds whole frames."""
    assert semantic_map.history.log.last == semantic_map.sequence
    with semantic_map.at(semantic_map.sequence) as now:
        assert _facts(now) == _facts(semantic_map)
    counts = {record.observations for record in semantic_map.objects()}
    assert counts == {semantic_map.recordings()[0].frames_applied}


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of three frames whose writer was killed with the fourth in the log alone."""
    path = tmp_path_factory.mktemp("left") / "flat.map"
    with create_map(path, base=BASE) as semantic_map:
        for number in range(3):
            semantic_map.apply(frame_update(number))
    process = program(_WRITER, path, CONFTEST, "between")
    out, err = process.communicate(timeout=300)
    assert (process.returncode, out, err) == (-signal.SIGKILL, "", "")
    return path


@pytest.fixture
def crashed(left: Path, tmp_path: Path) -> Path:
    return shutil.copytree(left, tmp_path / "crashed.map")


@pytest.mark.parametrize("read_only", [False, True])
def test_killed_between_log_and_store(crashed: Path, read_only: bool) -> None:
    with TransactionalStore.open(crashed) as store:
        assert store.sequence == 3
    with open_map(crashed, read_only=read_only) as semantic_map:
        assert semantic_map.store.read_only == read_only
        assert semantic_map.sequence == 4
        _agrees(semantic_map)


def test_readers_that_come_at_once_all_see_what_the_crash_kept_from_the_store(crashed):
    together = threading.Barrier(6)

    def read(_: int) -> int:
        together.wait(timeout=300)
        with open_map(crashed, read_only=True) as semantic_map:
            return semantic_map.sequence

    with ThreadPoolExecutor(6) as readers:
        assert list(readers.map(read, range(6))) == [4] * 6


@pytest.mark.parametrize("mode", ["fast", "safe"])
def test_killed_at_any_moment(written: Written, tmp_path: Path, mode: str) -> None:
    path = tmp_path / "flat.map"
    written(1).close()
    rng = random.Random(7)
    for _ in range(2):
        acknowledged = told_until_killed(program(_WRITER, path, CONFTEST, mode), rng)
        with open_map(path) as semantic_map:
            assert semantic_map.sequence >= acknowledged
            _agrees(semantic_map)


@pytest.mark.parametrize("forgets", [False, True])
def test_an_old_copy_of_the_store_catches_up(written, tmp_path, frame, forgets):
    path, copy = tmp_path / "flat.map", tmp_path / "copy"
    written(2).close()
    shutil.copytree(path / "store", copy)
    with open_map(path) as semantic_map:
        for number in range(2, 6):
            semantic_map.apply(frame(number, removed=(semantic_map.base + "object/2",)))
        if forgets:  # the copy is older than the kept past
            semantic_map.history.compact(keep=0.0)
        latest = _facts(semantic_map)
    shutil.rmtree(path / "store")
    shutil.copytree(copy, path / "store")
    with open_map(path) as semantic_map:
        assert _facts(semantic_map) == latest


def test_what_was_written_without_the_log_enters_it(written, tmp_path, frame):
    path = tmp_path / "flat.map"
    with written(3) as semantic_map:
        third = _facts(semantic_map)
    shutil.copy(path / FILE, tmp_path / "old")
    with open_map(path) as semantic_map:
        semantic_map.apply(frame(3))
        semantic_map.apply(frame(4))
    shutil.copy(tmp_path / "old", path / FILE)
    with open_map(path) as semantic_map:
        _agrees(semantic_map)
        assert [c.sequence for c in semantic_map.history.changes()] == [1, 2, 3, 5]
        assert next(semantic_map.history.changes(3)).cause.kind == "recovery"
        with semantic_map.at(3) as then:
            assert _facts(then) == third
        semantic_map.apply(frame(5))
        _agrees(semantic_map)


def test_a_map_from_before_history_begins_one(written: Written, tmp_path: Path) -> None:
    path = tmp_path / "flat.map"
    written(3).close()
    (path / FILE).unlink()
    with open_map(path, read_only=True) as semantic_map:
        with pytest.raises(HistoryError, match="keeps no history"):
            semantic_map.at(1)
        assert semantic_map.history.explain("object/1")[0].because
    with open_map(path) as semantic_map:
        _agrees(semantic_map)
        with pytest.raises(HistoryError, match="there are #3 to #3"):
            semantic_map.at(1)
        with pytest.raises(HistoryError, match="changes up to #3 are not kept"):
            semantic_map.history.changes(1)


def test_another_maps_log_is_refused(written: Written, tmp_path: Path) -> None:
    written(1).close()
    create_map(tmp_path / "other.map").close()
    shutil.copy(tmp_path / "other.map" / FILE, tmp_path / "flat.map" / FILE)
    with pytest.raises(HistoryError, match="put the right file there"):
        open_map(tmp_path / "flat.map")


def test_a_log_of_another_format_is_refused_and_the_map_opens_without_it(written, tmp_path):
    path = tmp_path / "flat.map"
    with written(3) as semantic_map:
        semantic_map.history.log.db.execute("UPDATE meta SET value = 99 WHERE name = 'format'")
    with pytest.raises(HistoryError, match="a later version of hereabouts wrote") as refused:
        open_map(path)
    assert "move" not in str(refused.value)  # it is not to be thrown away
    with closing(sqlite3.connect(path / FILE)) as file, file:
        file.execute("UPDATE meta SET value = 1 WHERE name = 'format'")
    with pytest.raises(HistoryError, match=r"format 1.*move the file away.*the map itself stays"):
        open_map(path)
    (path / FILE).write_bytes(b"not a database, but long enough to be read" * 9)
    for read_only in (False, True):
        with pytest.raises(HistoryError, match="cannot read the history"):
            open_map(path, read_only=read_only)
    (path / FILE).unlink()
    with open_map(path) as semantic_map:
        assert len(semantic_map.objects()) == 2
        assert semantic_map.history.log.floor == 3


_ENDLESS = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n FROM r) SELECT n, n FROM r"


@pytest.mark.parametrize(
    "script",
    [
        f"DROP TABLE meta; CREATE VIEW meta (name, value) AS {_ENDLESS}",
        "CREATE TRIGGER later AFTER INSERT ON commits BEGIN DELETE FROM commits; END",
        "CREATE TABLE more (x)",
        "CREATE INDEX other ON commits (note)",
    ],
)
def test_a_strangers_tables_are_refused_at_once(written, tmp_path, script):
    written(2).close()
    with closing(sqlite3.connect(tmp_path / "flat.map" / FILE)) as file:
        file.executescript(script)
    for read_only in (False, True):
        with pytest.raises(HistoryError, match=r"was not made by hereabouts.*move the file away"):
            open_map(tmp_path / "flat.map", read_only=read_only)


def test_what_the_store_refuses_is_not_in_the_log(written, frame, monkeypatch):
    with written(2) as semantic_map:
        before = _facts(semantic_map)

        def full(*_: object) -> None:
            raise GraphError("no space left")

        with monkeypatch.context() as broken:
            broken.setattr(TransactionalStore, "_write", full)
            with pytest.raises(GraphError, match="no space left"):
                semantic_map.apply(frame(2))
        assert semantic_map.history.log.last == 2
        assert _facts(semantic_map) == before
        semantic_map.apply(frame(3))
        with semantic_map.at(3) as now:
            assert _facts(now) == _facts(semantic_map)


def test_power_safe_waits_for_the_disk(tmp_path: Path) -> None:
    for safe, level in ((False, 1), (True, 2)):
        path = tmp_path / f"{safe}.map"
        with create_map(path, power_safe=safe) as semantic_map:
            assert semantic_map.history.log.db.execute("PRAGMA synchronous").fetchone() == (level,)
            assert semantic_map.history.log.db.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_last_transaction_that_cannot_be_read_is_set_aside(crashed, caplog):
    path, before = crashed, 3
    with closing(sqlite3.connect(path / FILE)) as log, log:
        log.execute("UPDATE change SET data = substr(data, 1, 20) WHERE sequence > ?", (before,))
    with open_map(path) as semantic_map:
        assert semantic_map.sequence == before
        _agrees(semantic_map)
        semantic_map.update("INSERT DATA { <object/9> <urn:p> 1 }", by="ann")
    copy = f"history-set-aside-{before + 1}-1.sqlite"
    assert f"transactions from #{before + 1} on cannot be replayed" in caplog.text
    assert copy in caplog.text
    with closing(sqlite3.connect(path / copy)) as log:
        assert log.execute("SELECT max(sequence) FROM commits").fetchone() == (before + 1,)
    with open_map(path, read_only=True) as semantic_map:
        assert semantic_map.sequence == before + 1
