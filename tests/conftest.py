"""Fixtures every room's tests share."""

from __future__ import annotations

import gc
import importlib
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

# the commands that tests start are compiled once, not at each start, and so are the tests
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# as the command line has it: numpy's further threads take a processor that other tests need
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# nothing that is collected becomes garbage, and there is much of it
gc.disable()
from hypothesis import HealthCheck, settings  # noqa: E402

from tests.waiting import listens  # noqa: E402

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap

Captured = pytest.CaptureFixture[str]

# the same examples in every run, on a machine however slow: what one run finds, anybody finds again
_PATIENT = [HealthCheck.too_slow]
settings.register_profile("same", derandomize=True, deadline=None, suppress_health_check=_PATIENT)
# new examples in every run, to look for faults with: HEREABOUTS_EXPLORE=1
settings.register_profile("explore", deadline=None, suppress_health_check=_PATIENT)
settings.load_profile("explore" if os.environ.get("HEREABOUTS_EXPLORE") else "same")

ROOT = Path(__file__).resolve().parent.parent
os.environ["PYTHONPATH"] = str(ROOT)  # what tests start imports this tree, wherever it runs
SHARED = Path(os.environ.get("HEREABOUTS_SHARED", ROOT.parent / "shared"))


#: modules that take longest, as measured: begun first, so that no processor is idle at the end
LONGEST = (
    "tests/kg/maps/test_kills.py",
    "tests/hereabouts/demo/test_demo.py",
    "tests/hereabouts/cli/test_recordings_that_do_not_fit.py",
    "tests/hereabouts/cli/test_live_loops.py",
    "tests/perception/camera/test_depth_edges.py",
    "tests/benchmarks/test_odometry.py",
    "tests/hereabouts/cli/test_simulate.py",
    "tests/hereabouts/cli/test_live_bad_streams.py",
    "tests/kg/serving/editing/test_editing.py",
    "tests/mapping/objects/test_corrections.py",
    "tests/mapping/test_live_correction.py",
    "tests/kg/serving/server/test_ontology_over_http.py",
    "tests/hereabouts/cli/test_served_maps.py",
    "tests/perception/sources/test_depth_check.py",
    "tests/hereabouts/cli/test_ontology.py",
    "tests/perception/sources/live/test_live_tracker.py",
    "tests/kg/serving/server/test_map_page.py",
    "tests/perception/sources/test_estimated_poses.py",
    "tests/hereabouts/cli/test_serve.py",
    "tests/hereabouts/cli/test_live_outages.py",
    "tests/hereabouts/cli/test_mcp.py",
    "tests/hereabouts/cli/test_labels.py",
    "tests/hereabouts/cli/test_map_ask_find.py",
    "tests/kg/knowledge/ontology/test_owlapi.py",
    "tests/hereabouts/cli/test_bags.py",
    "tests/hereabouts/cli/test_evaluate.py",
    "tests/hereabouts/cli/test_hostile_ontology.py",
    "tests/perception/odometry/test_tracking.py",
    "tests/kg/serving/server/test_records_over_http.py",
    "tests/hereabouts/cli/test_search.py",
    "tests/benchmarks/test_rooms.py",
)


def pytest_xdist_auto_num_workers() -> int | None:
    """Three processes for two processors: a third of the time tests wait for servers and clocks."""
    if os.environ.get("PYTEST_XDIST_AUTO_NUM_WORKERS"):
        return None
    processors = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    )
    return (processors or 1) * 3 // 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest modules first; the tests of a module stay in their order."""
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.nodeid.partition("::")[0], len(place)))


def pytest_collection_finish() -> None:
    """Leave what every test shares out of garbage collections."""
    gc.freeze()
    gc.enable()


def shared_path(relative: str) -> Path:
    """A file or folder of the shared data; skips the test only where all of it is absent."""
    if not SHARED.is_dir():
        pytest.skip(f"shared data absent: set HEREABOUTS_SHARED (looked at {SHARED})")
    path = SHARED / relative
    assert path.exists(), f"{path} is missing although the shared data is there"
    return path


@pytest.fixture(scope="session")
def shared() -> object:
    """Callable: relative path -> path of shared data."""
    return shared_path


@pytest.fixture(scope="session")
def class_pair(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The value of --encoder for the pair of the bundled classifier and its classes' words."""
    from tests.encoder_files import words_of_classes, write_class_pair

    synsets = shared_path("bundled/words/imagenet_synsets.csv")
    return write_class_pair(tmp_path_factory.mktemp("pair"), words_of_classes(synsets))


@pytest.fixture
def semantic_map() -> Iterator[SemanticMap]:
    """A real, empty map in memory."""
    from kg.serving.opening import in_memory_map  # the tests of `perception` need no map

    with in_memory_map(base="https://example.org/map/") as made:
        yield made


@contextmanager
def running_server(folder: Path, *options: str, port: int | None = None) -> Iterator[str]:
    """A real Oxigraph server over `folder`, at `port` or a free one; gives its address."""
    binary = Path(sys.executable).with_name("oxigraph")
    for _ in range(5):  # somebody else may take the port between finding and binding it
        at = f"127.0.0.1:{port or _free_port()}"
        command = [str(binary), "serve", "-l", str(folder), "-b", at, *options]
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as server:
            try:
                if listens(int(at.rpartition(":")[2]), server):
                    yield f"http://{at}"
                    return
            finally:
                server.kill()
    raise AssertionError("the oxigraph server did not start")


@pytest.fixture
def sparql_server(tmp_path: Path) -> Iterator[str]:
    """Address of a fresh SPARQL server of another vendor's making, empty."""
    with running_server(tmp_path / "served") as address:
        yield address


def publish(semantic_map: SemanticMap, address: str) -> None:
    """Mirror the present state of a map into a SPARQL server."""
    from kg.serving.publishing import PublishTarget, snapshot_of

    with closing(PublishTarget(address)) as target:
        target.synchronise(semantic_map.base, snapshot_of(semantic_map))


@pytest.fixture
def start_server(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Callable: (name, option...) -> address of another such server, up until the test ends."""
    with ExitStack() as running:

        def start(name: str, *options: str) -> str:
            return running.enter_context(running_server(tmp_path / name, *options))

        yield start


@pytest.fixture(autouse=True)
def _only_loopback(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Tests reach no network but this machine's own loopback."""
    connect = socket.socket.connect

    def guarded(self: socket.socket, address: object) -> None:
        host = address[0] if isinstance(address, tuple) else address
        if isinstance(address, tuple) and host not in (
            "127.0.0.1",
            "127.0.0.2",
            "::1",
            "localhost",
        ):
            raise OSError(f"tests must not reach {host}")
        return connect(self, address)  # type: ignore[arg-type]

    monkeypatch.setattr(socket.socket, "connect", guarded)
    yield


VIRTUOSO_INI = """
[Database]
DatabaseFile = {work}/virtuoso.db
ErrorLogFile = {work}/virtuoso.log
LockFile = {work}/virtuoso.lck
TransactionFile = {work}/virtuoso.trx
xa_persistent_file = {work}/virtuoso.pxa
FileExtend = 200
TempStorage = TempDatabase
[TempDatabase]
DatabaseFile = {work}/temp.db
TransactionFile = {work}/temp.trx
[Parameters]
ServerPort = 127.0.0.1:{sql}
DisableUnixSocket = 1
ServerThreads = 20
CaseMode = 2
NumberOfBuffers = 10000
MaxDirtyBuffers = 6000
MaxQueryMem = 400M
DirsAllowed = {work}
[HTTPServer]
ServerPort = 127.0.0.1:{http}
ServerThreads = 10
MaxClientConnections = 10
[SPARQL]
ResultSetMaxRows = 1000000
MaxQueryExecutionTime = 60
"""


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def running_virtuoso(work: Path) -> Iterator[str]:
    """A real Virtuoso 7 over `work`, whose endpoint anybody may write; gives its address."""
    if shutil.which("virtuoso-t") is None or shutil.which("isql-vt") is None:
        pytest.skip("Virtuoso is not installed: apt-get install virtuoso-opensource-7-bin")
    work.mkdir(parents=True, exist_ok=True)
    http, sql = _free_port(), _free_port()
    ini = work / "virtuoso.ini"
    ini.write_text(VIRTUOSO_INI.format(work=work, http=http, sql=sql), encoding="utf-8")
    # a query that its compiler cannot cope with takes all the memory there is
    command = "ulimit -v 4000000; exec virtuoso-t +foreground +configfile virtuoso.ini"
    with (
        (work / "out.log").open("wb") as out,
        subprocess.Popen(["bash", "-c", command], cwd=work, stdout=out, stderr=out) as server,
    ):
        try:
            assert listens(http, server), (work / "out.log").read_text(errors="replace")
            grant = 'exec=grant SPARQL_UPDATE to "SPARQL";'
            client = ["isql-vt", f"127.0.0.1:{sql}", "dba", "dba", grant]
            subprocess.run(client, check=True, stdout=subprocess.DEVNULL, timeout=60)
            yield f"http://127.0.0.1:{http}"
        finally:
            server.kill()


def _main(program: str) -> Callable[[list[str]], int]:
    """The `main` of `python -m PROGRAM`."""
    main: Callable[[list[str]], int] = importlib.import_module(f"{program}.__main__").main
    return main


def failed(main: Callable[[list[str]], int], words: Sequence[object], capsys: Captured) -> str:
    """The line of a program that must fail with exit code 1 and one line."""
    capsys.readouterr()
    assert main([str(word) for word in words]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err


def printed(main: Callable[[list[str]], int], words: Sequence[object], capsys: Captured) -> str:
    """The standard output of a program that must succeed."""
    capsys.readouterr()
    assert main([str(word) for word in words]) == 0
    return capsys.readouterr().out


@pytest.fixture
def fails(capsys: Captured) -> Callable[..., str]:
    """Callable: the line of a program, by its module, that must fail."""
    return lambda program, *words: failed(_main(program), words, capsys)


@pytest.fixture
def prints(capsys: Captured) -> Callable[..., str]:
    """Callable: the standard output of a program, by its module, that must succeed."""
    return lambda program, *words: printed(_main(program), words, capsys)
