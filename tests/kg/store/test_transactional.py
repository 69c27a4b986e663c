"""Transactions, on a full disk too, and the memory of the process."""

import ctypes
import gc
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from pyoxigraph import Literal, NamedNode, Quad

from benchmarks.graph.ours import resident
from kg.model.errors import GraphError, MapBusyError, MapNotFoundError
from kg.model.platforms import gc_frozen, trim_heap
from kg.model.transactions import Cause
from kg.serving.opening import create_map, open_map
from kg.store import scheduling
from kg.store.transaction_quads import sequence_quad
from kg.store.transactional import TransactionalStore

ROOT = Path(__file__).resolve().parents[3]
CAUSE = Cause("update", by="a test")
GRAPH = NamedNode("http://example.org/graph")


def quad(number: int) -> Quad:
    return Quad(
        NamedNode(f"http://example.org/{number}"),
        NamedNode("http://example.org/n"),
        Literal(number),
        GRAPH,
    )


def in_another_process(path: Path, *, read_only: bool) -> str:
    code = (
        "import sys; from pathlib import Path\n"
        "from kg.store.transactional import TransactionalStore as Store\n"
        f"try: Store.open(Path({str(path)!r}), read_only={read_only}).close(); print('opened')\n"
        "except Exception as error: print(type(error).__name__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_what_was_written_is_there_after_reopening(tmp_path: Path) -> None:
    with TransactionalStore.create(tmp_path / "map", [quad(1)]) as store:
        store.commit([quad(1)], [quad(2), quad(3)], CAUSE)
    with TransactionalStore.open(tmp_path / "map", read_only=True) as store:
        assert set(store.engine) == {quad(2), quad(3), sequence_quad(1)}


def test_a_writer_keeps_every_other_process_out_until_it_closes(tmp_path: Path) -> None:
    path = tmp_path / "map"
    with TransactionalStore.create(path, []):
        assert in_another_process(path, read_only=False) == "MapBusyError"
        assert in_another_process(path, read_only=True) == "MapBusyError"
    assert in_another_process(path, read_only=False) == "opened"


def test_readers_share_but_keep_a_writer_out(tmp_path: Path) -> None:
    path = tmp_path / "map"
    TransactionalStore.create(path, []).close()
    with TransactionalStore.open(path, read_only=True):
        TransactionalStore.open(path, read_only=True).close()
        with pytest.raises(MapBusyError, match="already open"):
            TransactionalStore.open(path)


def test_opening_what_is_no_map_says_so_and_creates_nothing(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x")
    before = sorted(tmp_path.rglob("*"))
    for name, reason in (("nothing", "nothing is there"), ("folder", "store/"), ("file", "a file")):
        for read_only in (False, True):
            with pytest.raises(MapNotFoundError, match=reason) as caught:
                TransactionalStore.open(tmp_path / name, read_only=read_only)
            assert "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_broken_store_is_one_line_not_a_traceback(tmp_path: Path) -> None:
    TransactionalStore.create(tmp_path / "map", [quad(1)]).close()
    (tmp_path / "map" / "store" / "CURRENT").write_text("MANIFEST-999999\n")
    for _ in range(2):  # the failure leaves no lock
        with pytest.raises(GraphError, match="cannot open the map") as caught:
            TransactionalStore.open(tmp_path / "map")
        assert "\n" not in str(caught.value)


def test_creating_refuses_what_exists_but_takes_an_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    TransactionalStore.create(tmp_path / "empty", []).close()
    with pytest.raises(GraphError, match="already"):
        TransactionalStore.create(tmp_path / "empty", [])
    (tmp_path / "file").write_text("precious")
    with pytest.raises(GraphError, match="already"):
        TransactionalStore.create(tmp_path / "file", [])
    assert (tmp_path / "file").read_text() == "precious"
    with pytest.raises(GraphError, match="cannot create") as caught:
        TransactionalStore.create(tmp_path / "file" / "map", [])
    assert "\n" not in str(caught.value)


def test_a_creation_that_fails_midway_leaves_nothing(tmp_path: Path) -> None:
    def half() -> object:
        yield quad(1)
        raise RuntimeError("the source of quads broke")

    with pytest.raises(RuntimeError, match="broke"):
        TransactionalStore.create(tmp_path / "map", half())  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_creation_killed_midway_leaves_no_map_and_is_cleared_away(tmp_path: Path) -> None:
    code = (
        "import os; from pathlib import Path\n"
        "from kg.store.transactional import TransactionalStore\n"
        "def killed():\n    os.kill(os.getpid(), 9); yield\n"
        f"TransactionalStore.create(Path({str(tmp_path / 'map')!r}), killed())"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False)
    assert [p.name.startswith(".map.new-") for p in tmp_path.iterdir()] == [True]
    with pytest.raises(MapNotFoundError):
        TransactionalStore.open(tmp_path / "map")
    TransactionalStore.create(tmp_path / "map", [quad(1)]).close()
    assert [p.name for p in tmp_path.iterdir()] == ["map"]


def test_reading_only_refuses_to_write(tmp_path: Path) -> None:
    TransactionalStore.create(tmp_path / "map", [quad(1)]).close()
    with (
        TransactionalStore.open(tmp_path / "map", read_only=True) as store,
        pytest.raises(GraphError, match="reading only"),
    ):
        store.commit([], [quad(2)], CAUSE)


def test_a_closed_store_says_that_it_is_closed() -> None:
    store = TransactionalStore.in_memory([quad(1)])
    store.close()
    store.close()
    with pytest.raises(GraphError, match="closed"):
        _ = store.engine


def test_writers_flush_by_themselves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "FLUSH_EVERY", 0.01)
    flushed = threading.Event()
    flush = TransactionalStore.flush
    monkeypatch.setattr(TransactionalStore, "flush", lambda self: (flush(self), flushed.set()))
    with TransactionalStore.create(tmp_path / "map", []):
        assert flushed.wait(120)


def test_a_map_nobody_holds_any_more_is_let_go(tmp_path: Path) -> None:
    store = TransactionalStore.create(tmp_path / "map", [])
    del store
    end = time.monotonic() + 120
    while True:  # its own thread may hold it while it flushes
        try:
            TransactionalStore.open(tmp_path / "map").close()
            return
        except MapBusyError:
            assert time.monotonic() < end
            time.sleep(0.05)


FILL = """
import resource, sys
from kg.model.errors import GraphError
from kg.serving.opening import open_map
errors = []
try:
    with open_map(sys.argv[1]) as semantic_map:
        # no file may grow any more, and the kernel says so as it does on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 17, resource.RLIM_INFINITY))
        for number in range(3000):
            text = f"INSERT DATA {{ <urn:n:{number}> rdfs:comment '{'x' * 500}' }}"
            try:
                semantic_map.update(text)
                print(number, flush=True)
            except GraphError as error:
                errors.append(error)
                if len(errors) == 3:
                    break
except GraphError as error:
    errors.append(error)
assert len(errors) >= 3, errors
assert all("cannot write" in str(error) for error in errors), errors
"""


def test_what_cannot_be_written_is_an_error_and_what_was_acknowledged_stays(tmp_path: Path) -> None:
    path = tmp_path / "full.map"
    create_map(path).close()
    words = [sys.executable, "-c", FILL, str(path)]
    ran = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    acknowledged = [int(line) for line in ran.stdout.split()]
    assert len(acknowledged) > 10
    with open_map(path) as semantic_map:
        kept = semantic_map.query("SELECT ?s { ?s rdfs:comment ?x }").rows
        assert {f"urn:n:{number}" for number in acknowledged} <= {row[0] for row in kept}
        semantic_map.update("INSERT DATA { <urn:n:last> rdfs:comment 'room again' }")


def test_existing_objects_are_exempt_for_the_length_of_the_block() -> None:
    before = gc.get_freeze_count()
    mine = [[]]
    with pytest.raises(KeyError), gc_frozen():
        assert gc.get_freeze_count() > before
        assert all(found is not mine for found in gc.get_objects())
        raise KeyError
    assert any(found is mine for found in gc.get_objects())


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="only glibc can be asked to"
)
def test_free_memory_between_used_blocks_is_returned() -> None:
    pieces = [bytes(1000 + number % 5000) for number in range(40_000)]  # 140 MB
    kept = pieces[::7]
    del pieces
    before = resident()
    assert trim_heap()
    assert len(kept) == 5715
    assert resident() < before - 50e6
