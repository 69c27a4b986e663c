"""Folders of strangers, and folders whose writer was killed: reading them writes nothing."""

import ctypes
import os
import shutil
import struct
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from pyoxigraph import NamedNode, Quad

from hereabouts.cli import main
from hereabouts.display.plots.picture_file import save_picture
from kg.history.storage.log import HistoryLog
from kg.maps.surface.surface_store import SurfaceStore
from kg.model.errors import GraphError, HereaboutsError, MapBusyError
from kg.model.sqlite_files import open_sqlite
from kg.model.transactions import Cause, ChangeSet
from kg.serving.opening import create_map, open_map
from kg.store.folder import announce, write_atomically

IN_CREATE = 0x100  # of inotify
_MAGIC = bytes([0xD9, 0xD5, 0x05, 0xF9, 0x20, 0xA1, 0x63, 0xD7])


def super_journal(database: Path, victim: Path) -> None:
    """A rollback journal beside `database`, after whose recovery SQLite deletes `victim`."""
    page = 1024
    pages = max(1, database.stat().st_size // page) if database.exists() else 1
    head = _MAGIC + struct.pack(">IIIII", 0, 1, pages, 512, page)
    name = str(victim).encode()
    total = sum(b - 256 * (b > 127) for b in name) & 0xFFFFFFFF
    foot = struct.pack(">I", 0x40000000 // page + 1) + name
    foot += struct.pack(">II", len(name), total) + _MAGIC
    Path(f"{database}-journal").write_bytes(head.ljust(512, b"\0") + foot)


def files(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Size, number and time of change of all that lies in a folder."""
    return {
        str(path.relative_to(folder)): (status.st_size, status.st_ino, status.st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if (status := path.lstat())
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "a.map"
    with create_map(path) as semantic_map:
        semantic_map.describe(licence="https://example.org/first")
        assert semantic_map.surface_store is not None
        semantic_map.surface_store.begin(0.05)
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "a.map")


def copied(path: Path, copy: Path) -> None:
    """A copy of a folder, as a kill would leave it, between two flushes of its writer."""
    while True:
        try:
            shutil.copytree(path, copy)
            return
        except shutil.Error:
            shutil.rmtree(copy)


@pytest.fixture(
    scope="module", params=["closed", "killed", "behind", "without its index", "without a lock"]
)
def left(request, made, tmp_path_factory):
    """A map after its writer was closed, or killed after or before the store had all."""
    path = shutil.copytree(made, tmp_path_factory.mktemp("left") / "a.map")
    copy = path.with_name("left.map")
    with open_map(path) as semantic_map:
        semantic_map.describe(licence="https://example.org/last")
        if request.param == "behind":
            store = semantic_map.store
            assert store.journal is not None
            last = next(semantic_map.history.changes(store.sequence - 1))
            (old,) = last.added
            value = NamedNode(f"{old.object.value}-of-the-log")
            new = Quad(old.subject, old.predicate, value, old.graph_name)
            change = ChangeSet(store.sequence + 1, last.time, Cause("update"), (new,), (old,))
            store.journal.append(change)
        if request.param not in ("closed", "without a lock"):
            copied(path, copy)
            assert (copy / "history.sqlite-wal").stat().st_size
    if not copy.exists():
        shutil.copytree(path, copy)
    (copy / "lock").unlink()
    if request.param != "without a lock":
        (copy / "lock").touch()
    if request.param == "without its index":
        (copy / "history.sqlite-shm").unlink()
    return copy


@pytest.fixture
def state(left: Path, tmp_path: Path) -> Path:
    return shutil.copytree(left, tmp_path / "left.map")


@pytest.mark.parametrize("name", ["history", "what-comes-next"])
def test_a_journal_beside_a_database_deletes_nothing(path: Path, tmp_path: Path, name: str) -> None:
    victim = tmp_path / "thesis.tex"
    victim.write_text("years of work")
    super_journal(path / f"{name}.sqlite", victim)
    before = files(path)
    for read_only in (True, False):
        with pytest.raises(GraphError, match=rf"holds {name}\.sqlite-journal, a rollback journal"):
            open_map(path, read_only=read_only)
    assert victim.read_text() == "years of work"
    assert files(path) == before


@pytest.mark.parametrize("read_only", [True, False])
def test_whoever_opens_a_database_of_a_map_refuses_a_journal(path, tmp_path, read_only):
    victim = tmp_path / "thesis.tex"
    victim.write_text("years of work")
    for name in ("history", "surface"):
        super_journal(path / f"{name}.sqlite", victim)
    with pytest.raises(GraphError, match="rollback journal"):
        HistoryLog.open(path / "history.sqlite", "https://example.org/", read_only=read_only)
    with pytest.raises(GraphError, match="rollback journal"):
        SurfaceStore(path, 1, read_only=read_only).surface()
    with pytest.raises(ValueError, match="rollback journal"):
        open_sqlite(path / "surface.sqlite", ["x"], 1, 1 << 30, read_only=read_only)
    assert victim.exists()


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("lock", "link"), ("history.sqlite", "pipe"), ("history.sqlite-wal", "broken link")),
        *(("store/CURRENT", "pipe"), ("store/000005.log", "link"), ("scratch", "broken link")),
    ],
)
def test_links_and_pipes_in_a_map_are_refused_in_one_line(path, tmp_path, name, kind):
    target = tmp_path / "mine"
    if kind == "link":
        target.write_text("mine")
    (path / name).unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(path / name)
    else:
        (path / name).symlink_to(target)
    for read_only in (True, False):
        with pytest.raises(HereaboutsError, match=r"^[^\n]*(a link|a pipe|holds no store)[^\n]*$"):
            open_map(path, read_only=read_only)
    assert target.exists() == (kind == "link")
    assert not target.exists() or target.read_text() == "mine"


def test_a_store_elsewhere_is_not_followed(path: Path, tmp_path: Path) -> None:
    (path / "store").rename(tmp_path / "elsewhere")
    (path / "store").symlink_to(tmp_path / "elsewhere")
    before = files(tmp_path / "elsewhere")
    for read_only in (True, False):
        with pytest.raises(GraphError, match="holds store, a link"):
            open_map(path, read_only=read_only)
    assert files(tmp_path / "elsewhere") == before


def test_a_second_name_of_a_database_is_not_written(path: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    os.link(tmp_path / "mine", path / "surface.sqlite-shm")
    with open_map(path) as semantic_map, pytest.raises(GraphError, match="2 names"):
        semantic_map.surface()
    assert (tmp_path / "mine").read_text() == "mine"


def test_reading_writes_nothing_and_has_the_last_transaction(state: Path) -> None:
    before, temporary = files(state), {*Path("/tmp").glob("hereabouts-*")}
    with open_map(state, read_only=True) as semantic_map:
        assert str(semantic_map.description.licence).startswith("https://example.org/last")
        assert semantic_map.history.log.last == semantic_map.sequence
        assert len(semantic_map.surface().points) == 0
        assert semantic_map.at(1).description.licence == "https://example.org/first"
        with pytest.raises(GraphError, match="for reading only"):
            semantic_map.describe(title="mine")
    assert files(state) == before
    assert {*Path("/tmp").glob("hereabouts-*")} <= temporary
    with open_map(state) as semantic_map:  # what was killed goes on
        semantic_map.describe(licence="https://example.org/next")
        sequence = semantic_map.sequence
    with open_map(state, read_only=True) as semantic_map:
        assert semantic_map.description.licence == "https://example.org/next"
        assert semantic_map.sequence == sequence


def test_commands_that_read_write_nothing(state: Path, tmp_path: Path) -> None:
    before = files(state)
    for words in ("ask MAP objects", "export MAP -o OUT.ttl", "floor MAP -o OUT.yaml"):
        main(words.replace("MAP", str(state)).replace("OUT", str(tmp_path / "out")).split())
        assert files(state) == before, words


def test_a_folder_that_nobody_may_write_is_read(state: Path) -> None:
    folders = [state, *(path for path in state.rglob("*") if path.is_dir())]
    for folder in folders:
        folder.chmod(0o500)
    try:
        with open_map(state, read_only=True) as semantic_map:
            assert str(semantic_map.description.licence).startswith("https://example.org/last")
    finally:
        for folder in folders:
            folder.chmod(0o700)


def test_a_reader_without_a_lock_file_keeps_writers_out(path: Path) -> None:
    (path / "lock").unlink()
    with open_map(path, read_only=True):
        assert not (path / "lock").exists()
        with pytest.raises(MapBusyError):
            open_map(path)
    open_map(path).close()


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux tells of made files")
@pytest.mark.parametrize("auto_vacuum", [False, True])
def test_a_new_database_never_has_a_journal(tmp_path: Path, auto_vacuum: bool) -> None:
    kernel = ctypes.CDLL(None, use_errno=True)
    told = kernel.inotify_init1(os.O_NONBLOCK)
    assert kernel.inotify_add_watch(told, os.fsencode(tmp_path), IN_CREATE) >= 0
    file = open_sqlite(
        tmp_path / "new", ["CREATE TABLE a (b)"], 1, 1 << 30, auto_vacuum=auto_vacuum
    )
    file.close()
    made = os.read(told, 1 << 16)  # events of files that were made, with their names
    os.close(told)
    assert b"new.part\0" in made and b"new.part-wal" in made
    assert b"-journal" not in made


def test_no_output_is_written_into_a_map(path: Path) -> None:
    (path / "lock").unlink()
    before = files(path)
    for output in (path / "history.sqlite", path / "store" / "out.png", path):
        with pytest.raises(GraphError, match=r"inside the folder of the map a\.map"):
            write_atomically(output, "text")
        with pytest.raises(GraphError, match=r"inside the folder of the map a\.map"):
            save_picture(Figure(), output)
        assert main(["export", str(path), "-o", str(output), "--format", "turtle"]) == 1
    assert files(path) == before


def test_a_lock_with_a_second_name_is_not_written_to(path: Path, tmp_path: Path) -> None:
    (path / "lock").write_text("mine")
    os.link(path / "lock", tmp_path / "thesis.tex")
    with pytest.raises(OSError, match="second name"):
        announce(path, "http://127.0.0.1:1/")
    assert (tmp_path / "thesis.tex").read_text() == "mine"
