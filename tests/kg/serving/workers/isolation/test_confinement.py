"""An attacker who executes code in a worker: the kernel refuses what the worker does not need."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map
from kg.serving.workers import process
from kg.serving.workers.isolation.confinement import Confinement
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import WorkerProcess, settings_of
from kg.serving.workers.updates import UpdateRequest, update_map
from kg.store.snapshots import Snapshots
from tests.kg.serving.workers import probes

ROOT = Path(__file__).resolve().parents[5]
START = "import sys; sys.path[:0] = sys.argv[2:]; from tests.kg.serving.workers.probes import main"


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SemanticMap]:
    with create_map(tmp_path_factory.mktemp("confined") / "home.map") as made:
        made.update("INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 } }")
        yield made


@pytest.fixture(scope="module")
def attempted(live: SemanticMap) -> Iterator[dict[str, str]]:
    """Results of all acts, in a worker that was taken over."""
    if not probes.has_landlock():
        pytest.skip("the kernel of this machine has no Landlock, so files are not shut")
    snapshots = Snapshots(live.store, refresh=60)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "_START", f"{START}; main()")
        settings = settings_of(512, (), snapshots.readable, snapshots.writable)
        worker = WorkerProcess(settings)
    folder = snapshots.lease().folder
    answer = worker.ask({"folder": str(folder)}, 60)
    assert worker.confinement == Confinement("seccomp", files=True), "this machine has no Landlock"
    assert (folder / "CURRENT").read_bytes() and sorted((folder.parent / "scratch").iterdir()) == []
    yield json.loads(answer.body)
    worker.close()
    snapshots.close()


@pytest.mark.parametrize("act", probes.ACTS)
def test_a_worker_that_was_taken_over_cannot(attempted: dict[str, str], act: str) -> None:
    assert attempted[act] != "done"


def test_the_same_acts_succeed_where_nothing_confines_them(tmp_path: Path) -> None:
    (tmp_path / "snapshot").mkdir()
    (tmp_path / "scratch").mkdir()
    ran = subprocess.run(
        [sys.executable, "-m", "tests.kg.serving.workers.probes", str(tmp_path / "snapshot")],
        cwd=ROOT, capture_output=True, text=True, check=True, start_new_session=True,
    )  # fmt: skip
    assert set(json.loads(ran.stdout).values()) == {"done"}


def test_a_confined_worker_writes_the_copies_of_updates_and_reads_the_history(
    live: SemanticMap,
) -> None:
    update = (
        "INSERT DATA { GRAPH <urn:g> { <urn:t> <urn:p> 2 } } ; "
        "INSERT { GRAPH <urn:g> { ?s <urn:q> 3 } } WHERE { GRAPH <urn:g> { ?s <urn:p> 2 } }"
    )
    with QueryPool(live, workers=1, timeout=60) as pool:
        before = live.sequence
        update_map(pool, live, UpdateRequest(update), by="ann")  # type: ignore[arg-type]
        assert b"true" in pool.run("ASK { <urn:t> <urn:q> 3 }", at_least=live.sequence).body
        assert b"false" in pool.run("ASK { <urn:t> <urn:q> 3 }", at=before).body


def test_warnings_name_what_the_kernel_cannot_do() -> None:
    assert Confinement("seccomp", files=True).warnings() == []
    assert ["Landlock" in line for line in Confinement("seccomp").warnings()] == [True]
    assert len(Confinement().warnings()) == 3
    assert len(Confinement("namespace", files=True).warnings()) == 1


HIDE = """
import ctypes, os
from kg.serving.workers.isolation.confinement import hide_memory
if os.geteuid() == 0:
    os.setgroups([]); os.setgid(65534); os.setuid(65534)
    ctypes.CDLL(None).prctl(4, 1, 0, 0, 0)  # dumpable, as a program of this user is at its start
owner = lambda: os.stat("/proc/self/environ").st_uid
assert owner() == os.geteuid()
hide_memory()
assert owner() == 0, "files of a process that is not dumpable belong to root"
"""


def test_memory_of_a_server_is_hidden() -> None:
    subprocess.run([sys.executable, "-c", HIDE], cwd=ROOT, check=True)
