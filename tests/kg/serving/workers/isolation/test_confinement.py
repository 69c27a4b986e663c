"""Confinement of the workers, and their network."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.attack.listener import Listener
from benchmarks.attack.spellings import documents, fuzzed, queries, updates
from hereabouts.cli import main
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryError, QueryRefusedError
from kg.serving.opening import create_map, in_memory_map
from kg.serving.server import BearerTokens, Limits, MapServer, Settings
from kg.serving.workers import process
from kg.serving.workers.isolation import Confinement
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import WorkerProcess, settings_of
from kg.serving.workers.request import query_call
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


def test_a_confined_worker_writes_the_copies_of_updates_and_reads_the_history(live):
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
from kg.serving.workers.isolation import hide_memory
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


NOBODY = 65534
TOKEN = "a-token-of-the-tests-0123"

#: evaluates texts with the bare engine, without any scanner, in a process denied by one mechanism
EVALUATE = """
import json, os, socket, sys
import pyoxigraph as ox
from kg.serving.workers import isolation
how, uid, texts = sys.argv[1], int(sys.argv[2]), json.load(sys.stdin)
if uid:
    os.setgroups([]); os.setgid(uid); os.setuid(uid)
if how != "none":
    getattr(isolation, how)()
for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
    print("denied", isolation.is_denied())
store = ox.Store()
values = "1, true, 1.0, 'x', .5, 1e0, <urn:x>"
store.update("INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> " + values + " } }")
ask = lambda text: store.query(text, use_default_graph_as_union=True)
for text in texts:
    for run in (lambda: ask(text), lambda: store.update(text)):
        try:
            results = run()
            if results is not None and not isinstance(results, ox.QueryBoolean):
                list(results)
        except (SyntaxError, OSError, RuntimeError, ValueError):
            pass
"""


@pytest.fixture
def listener() -> Iterator[Listener]:
    with Listener() as opened:
        yield opened


def evaluated(how: str, uid: int, texts: list[str]) -> str:
    ran = subprocess.run(
        [sys.executable, "-c", EVALUATE, how, str(uid)],
        cwd=Path(__file__).resolve().parents[5], input=json.dumps(texts), text=True,
        capture_output=True, check=False, timeout=300,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def texts_for(listener: Listener) -> list[str]:
    asked, written = queries(listener.address), updates(listener.address)
    return [*asked, *written, *fuzzed([*asked, *written], 100)]


def test_the_spellings_reach_the_network_where_nothing_denies_it(listener: Listener) -> None:
    evaluated("none", 0, texts_for(listener))
    assert listener.arrived() >= 200


@pytest.mark.parametrize("how", ["deny_network", "filter_system_calls", "unshare_network"])
@pytest.mark.parametrize("uid", [0, NOBODY] if os.geteuid() == 0 else [0])
def test_the_kernel_alone_denies_every_spelling(listener: Listener, how: str, uid: int) -> None:
    texts = texts_for(listener)
    assert len(texts) >= 400
    assert "denied False" not in evaluated(how, uid, texts)
    assert listener.arrived() == 0


def test_a_worker_reports_how_it_is_denied_and_inherits_no_descriptor() -> None:
    with in_memory_map() as home, socket.create_server(("127.0.0.1", 0)) as open_socket:
        os.set_inheritable(open_socket.fileno(), True)
        with QueryPool(home, workers=1) as pool:
            assert pool.confinement.denies_network
            descriptors = Path(f"/proc/{pool.pids[0]}/fd").iterdir()
            assert not [fd for fd in descriptors if "socket:" in str(fd.readlink())]


def test_nothing_a_server_is_sent_reaches_the_network(listener: Listener) -> None:
    limits = Limits(query_seconds=60)
    settings = Settings(port=0, tokens=BearerTokens((("ann", TOKEN.encode()),)), limits=limits)
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    asked, written = queries(listener.address, 100), updates(listener.address)
    with in_memory_map() as home, MapServer(home, settings) as server:
        home.update("INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 , 'x' , <urn:x> } }")
        import requests

        session = requests.Session()
        session.headers.update(bearer)

        def post(path: str, **given: object) -> None:
            reply = session.post(server.url + path, timeout=120, **given)  # type: ignore[arg-type]
            assert Listener.SECRET not in reply.text
            assert reply.status_code != 429

        for text in [*asked, *fuzzed(asked, 50)]:
            post("sparql", data={"query": text})
        for text in asked[::8]:
            post("sparql", data={"query": text, "at": "1"})
            params = {"query": text}
            with session.get(
                server.url + "subscribe", params=params, stream=True, timeout=120
            ) as r:
                assert r.status_code in (200, 400, 503)
        for text in written:
            post("sparql", data={"update": text})
        for kind, body in documents(listener.address):
            post("graphs?graph=urn:new", data=body, headers={"Content-Type": kind})
    assert listener.arrived() == 0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with create_map(tmp_path / "home.map") as made:
        made.update("INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 , 'x' } }")
    return tmp_path / "home.map"


GLUED = "PREFIX a·b: <{0}> SELECT * {{ ?s ?p 1SERVICE a·b:x {{ ?a ?b ?c }} }}"


def test_the_command_line_reaches_nothing(folder, listener, tmp_path, capsys):
    file = tmp_path / "own.rq"
    file.write_text(GLUED.format(listener.address))
    update = f"INSERT {{ ?a ?b ?c }} WHERE {{ ?s ?p 1SERVICE <{listener.address}> {{ ?a ?b ?c }} }}"
    for words in (
        ["ask", str(folder), "-e", GLUED.format(listener.address)],
        ["ask", str(folder), str(file)],
        ["ask", str(folder), "--at", "#1", "-e", GLUED.format(listener.address)],
        ["update", str(folder), "-e", update],
    ):
        assert main(words) == 1
        error = capsys.readouterr().err
        assert error.startswith("error: ") and error.count("\n") == 1
        assert Listener.SECRET not in error
    assert listener.arrived() == 0


def test_an_error_of_an_allowed_endpoint_quotes_no_reply(listener: Listener) -> None:
    with (
        in_memory_map() as home,
        QueryPool(home, workers=1, services=(listener.address,)) as pool,
        pytest.raises(QueryError, match="endpoint of SERVICE") as caught,
    ):
        pool.run(f"SELECT * {{ SERVICE <{listener.address}> {{ ?s ?p ?o }} }}")
    assert listener.arrived() == 1
    assert Listener.SECRET not in str(caught.value)


def test_without_a_denial_the_letters_alone_are_refused() -> None:
    with in_memory_map() as home:
        snapshots = Snapshots(home.store, refresh=60)
        worker = WorkerProcess(settings_of(512, (), snapshots.readable), network=True)
        where = {"folder": str(snapshots.lease().folder), "max_bytes": 1000}
        for text in ("?service ?p 'a SERVICE'", "?s ?p '\\u0053ERVICE'", "?s ?p 'download'"):
            with pytest.raises(QueryRefusedError):
                worker.ask(query_call(f"ASK {{ {text} }}").body | where, 60)
        assert worker.ask(query_call("ASK { ?s ?p 'x' }").body | where, 60).body
        worker.close()
        snapshots.close()
