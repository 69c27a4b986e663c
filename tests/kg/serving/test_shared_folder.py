"""A folder that is written is open: other processes of its user read it, and edit through it."""

import gc
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import ExternalChanges
from kg.model.errors import ConflictError, GraphError, InvalidFactError, MapBusyError
from kg.model.records import MapUpdate
from kg.model.transactions import Cause
from kg.serving import folder_server
from kg.serving.folder_server import FolderClient
from kg.serving.opening import create_map, open_map, watch_map
from kg.serving.shared_folder import SharedMap, recover_copy
from kg.store.folder import announced
from tests.kg.conftest import BASE, frame_update
from tests.waiting import HEREABOUTS, until

ROOT = Path(__file__).resolve().parents[3]
Written = Callable[[int], SemanticMap]
_WRITER = """
import sys, time
from kg.serving.opening import open_map
with open_map(sys.argv[1]) as semantic_map:
    print("open", flush=True)
    time.sleep(600)
"""


def run(*words: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    return subprocess.run([*HEREABOUTS, *words], capture_output=True, text=True)


def path_of(semantic_map: SemanticMap) -> str:
    return str(semantic_map.store.where)


def beside(path: str) -> list[str]:
    """What lies beside a map."""
    return sorted(each.name for each in Path(path).parent.iterdir() if each != Path(path))


@pytest.fixture
def writer(written: Written) -> Iterator[SemanticMap]:
    with written(3) as semantic_map:
        yield semantic_map


def test_another_process_reads_and_edits_the_map_that_is_written(writer: SemanticMap) -> None:
    path, before = path_of(writer), writer.sequence
    asked = run("ask", path, "SELECT ?o { ?o a here:Chair }", "--json")
    assert (asked.returncode, asked.stderr) == (0, "")
    assert asked.stdout.count("object/") == 2
    named = run("name", path, "object/1", "throne", "--by", "ann")
    assert named.returncode == 0, named.stderr
    (assertion,) = writer.assertions.all("object/1")
    assert (assertion.property, assertion.by) == ("category", "ann")
    assert writer.sequence == before + 2  # the name, and its category
    assert writer.apply(frame_update(3)) is not None  # its caches know of the edit
    assert len(beside(path)) == 1  # the writer's last snapshot
    writer.close()
    assert beside(path) == []


@pytest.mark.parametrize(
    "words",
    [
        *("status MAP chair", "find MAP chair", "log MAP object/1", "why MAP object/1"),
        *("plot MAP -o OUT.png", "export MAP -o OUT.ttl", "rooms MAP", "check MAP", "diff MAP"),
        *("describe MAP --title mine", "assert MAP object/1 label mine --by ann", "compact MAP"),
        "update MAP --by ann -e DELETE{?o~here:x~?x}INSERT{?o~here:x~9.5}"
        "WHERE{?o~a~here:Chair;here:x~?x}",
    ],
)
def test_commands_beside_a_writer(writer: SemanticMap, tmp_path: Path, words: str) -> None:
    places = {"MAP": path_of(writer), "OUT.png": str(tmp_path / "o.png")}
    places["OUT.ttl"] = str(tmp_path / "o.ttl")
    if words.startswith("diff"):
        words += " #1 #2"
    given = [places.get(word, word).replace("~", " ") for word in words.split()]
    assert main(given) == 0
    assert writer.apply(frame_update(3)) is not None


def test_a_reader_sees_each_change_within_a_second(writer: SemanticMap) -> None:
    with open_map(path_of(writer), read_only=True) as reader:
        assert isinstance(reader, SharedMap)
        for frame in range(3, 6):
            writer.apply(frame_update(frame))
            written = writer.objects()
            until(lambda: reader.sequence == writer.sequence)
            assert reader.sequence == reader.history.log.last
            assert [o.observations for o in reader.objects()] == [o.observations for o in written]
        category = "https://w3id.org/hereabouts#Chair"
        writer.ontology.learn(["whatsit"], "object", model="m")
        until(lambda: reader.sequence == writer.sequence)
        assert reader.catalogue.find("whatsit", "object")
        assert {o.category for o in reader.objects()} == {category}
        assert reader.at(2).sequence == 2
        with pytest.raises(GraphError, match="for reading only"):
            reader.describe(title="mine")


def test_edits_of_a_program_are_the_writers_own(writer: SemanticMap) -> None:
    with open_map(path_of(writer)) as editor:
        made = editor.assertions.add("object/1", "label", "mine", by="ann")
        assert made is not None and made.sequence == writer.sequence == editor.sequence
        assert [a.value for a in editor.assertions.all()] == ["mine"]
        assert writer.query("SELECT ?l { <object/1> rdfs:label ?l }").rows == (("mine",),)
        assert editor.describe(title="flat") is not None
        assert writer.description.title == editor.description.title == "flat"
        moved = "DELETE { ?o here:x ?x } INSERT { ?o here:x 7.5 } WHERE { ?o here:x ?x }"
        editor.update(moved.replace("?o", "<object/1>"), by="bob", confirmed=True)
        assert writer.objects()[0].p_map[0] == 7.5
        with pytest.raises(InvalidFactError, match="is not asserted"):
            editor.assertions.retract("object/2", "label", by="ann")
        with pytest.raises(GraphError, match="frames do not"):
            editor.apply(frame_update(9))
    assert writer.apply(frame_update(4)) is not None


def test_a_search_writes_through_the_writer_unless_others_changed_the_same(
    writer: SemanticMap,
) -> None:
    cause = Cause("search", "search/1", "looked")
    with open_map(path_of(writer)) as searching:
        touched = ExternalChanges(searching)
        thing = searching.objects()[0]
        for confidence in (5.0, 6.0):  # its own earlier writes are no conflict
            moved = MapUpdate(objects=(replace(thing, confidence=confidence),))
            made = searching.apply(moved, cause)
            assert made is not None and made.sequence == writer.sequence
        assert touched.take() == frozenset()
        writer.assertions.add(thing.iri, "label", "mine", by="ann")
        with pytest.raises(ConflictError, match="others have changed object/1"):
            searching.apply(moved, cause)
        assert thing.iri in touched.take()
        assert searching.apply(replace(moved, objects=(thing,)), cause) is not None
        assert searching.new_object_iri() != searching.new_object_iri() != writer.new_object_iri()


def test_wrong_arguments_are_the_callers_error_and_end_nothing(writer: SemanticMap) -> None:
    with open_map(path_of(writer)) as other:
        with pytest.raises(TypeError, match="label"):
            other.assertions.add("object/1", label="throne", by="ann")  # type: ignore[call-arg]
        assert other.assertions.add("object/1", "label", "throne", by="ann") is not None


def test_who_holds_the_map_delays_its_writer_for_a_limited_time(writer, monkeypatch):
    held = 0.5
    monkeypatch.setattr(folder_server, "HELD", held)
    with open_map(path_of(writer)) as editor:
        with editor.hold():
            began = time.monotonic()
            writing = threading.Thread(target=writer.apply, args=[frame_update(3)])
            writing.start()
            writing.join()
            assert time.monotonic() - began > held / 2
            with pytest.raises(ConflictError, match="was held for more than"):
                editor.describe(title="late")
        assert editor.describe(title="in time") is not None


def test_a_writer_that_was_killed_blocks_nobody(written: Written) -> None:
    with written(2) as semantic_map:
        path = path_of(semantic_map)
    command = [sys.executable, "-c", _WRITER, path]
    with (
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process,
        watch_map(path) as reader,
    ):
        assert process.stdout is not None and process.stdout.readline() == "open\n"
        assert isinstance(reader, SharedMap)
        assert reader.sequence == 2
        with open_map(path) as editor:
            editor.describe(title="before the kill")
        process.send_signal(signal.SIGKILL)
        process.wait()
        until(lambda: reader.description.title == "before the kill")
        with open_map(path) as successor:
            assert not isinstance(successor, SharedMap)
            successor.describe(title="after it")
            until(lambda: reader.description.title == "after it")
            assert reader.history.log.last == successor.sequence
    assert beside(path) == []


def test_a_reader_over_hours_keeps_no_writer_out(written: Written) -> None:
    with written(2) as semantic_map:
        path = path_of(semantic_map)
    before = sorted(Path(path).iterdir())
    with watch_map(path) as reader:
        assert sorted(Path(path).iterdir()) == before
        for title in ("one", "two"):
            with open_map(path, exclusive=True) as writer:
                writer.describe(title=title)
            until(lambda: reader.description.title == title)  # noqa: B023
    assert beside(path) == []


def test_a_writer_waits_for_a_short_reader(written: Written) -> None:
    with written(1) as semantic_map:
        path = path_of(semantic_map)
    reader = open_map(path, read_only=True)
    threading.Timer(0.5, reader.close).start()
    with open_map(path, exclusive=True) as writer:
        assert writer.describe(title="mine") is not None


def test_frames_need_the_folder_alone(writer: SemanticMap) -> None:
    with pytest.raises(MapBusyError, match="already open"):
        open_map(path_of(writer), exclusive=True)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root has a second user")
def test_other_users_are_not_served_and_not_trusted(writer: SemanticMap) -> None:
    path = Path(path_of(writer))
    name = announced(path)
    assert name is not None
    asking = (
        "import socket, sys; peer = socket.socket(socket.AF_UNIX); "
        "peer.connect('\\0' + sys.argv[1]); sys.exit(len(peer.recv(1)))"
    )
    for user, received in ((65534, 0), (0, 1)):
        asked = subprocess.run(["/usr/bin/python3", "-c", asking, name], user=user, check=False)
        assert asked.returncode == received
    os.chown(path, 65534, -1)
    try:
        with pytest.raises(MapBusyError, match="does not serve this user"):
            FolderClient(path)
    finally:
        os.chown(path, 0, -1)


def test_a_folder_that_names_another_program_is_told(writer: SemanticMap) -> None:
    path = Path(path_of(writer))
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(f"\0other-{os.getpid()}")
        other.listen()
        (path / "lock").write_text(f"other-{os.getpid()}")
        threading.Thread(target=lambda: other.accept()[0].close(), daemon=True).start()
        with pytest.raises(MapBusyError, match="ends just now"):
            FolderClient(path)
    (path / "lock").write_text("nobody\nlistens" * 3)
    with pytest.raises(MapBusyError, match="does not serve this user"):
        FolderClient(path)


def test_a_copy_of_a_map_in_use_has_its_state_and_its_whole_history(
    writer: SemanticMap, tmp_path: Path
) -> None:
    """Of each transaction the cause and the facts, though files are still being written."""
    writer.assertions.add(writer.objects()[0].iri, "label", "my bed", by="ann")
    recover_copy(Path(path_of(writer)), tmp_path / "copy")
    with open_map(tmp_path / "copy", read_only=True) as copy:
        assert [*copy.history.changes()] == [*writer.history.changes()]
        assert {*copy.engine} == {*writer.engine}


def test_a_map_that_nobody_holds_is_free(tmp_path: Path) -> None:
    create_map(tmp_path / "a.map", base=BASE)
    gc.collect()
    open_map(tmp_path / "a.map", exclusive=True).close()


def test_a_writer_that_is_stopped_does_not_hold_a_reader_for_a_minute(written, monkeypatch):
    monkeypatch.setattr(folder_server, "_SOON", 0.5)
    with written(3) as semantic_map:
        path = path_of(semantic_map)
    writer = subprocess.Popen(
        [sys.executable, "-c", _WRITER, path], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert writer.stdout is not None and writer.stdout.readline() == "open\n"
    client = FolderClient(Path(path))
    os.kill(writer.pid, signal.SIGSTOP)
    os.waitpid(writer.pid, os.WUNTRACED)
    try:
        with pytest.raises(MapBusyError, match="has ended or hangs"):
            client.call("snapshot", str(Path(path).parent / "copy"), 0, -1)
        os.kill(writer.pid, signal.SIGCONT)
        with pytest.raises(MapBusyError):  # its late answer is nobody's
            client.call("sequence")
        again = FolderClient(Path(path))
        assert again.call("sequence") == 3
        again.close()
    finally:
        writer.kill()
        writer.wait()
        writer.stdout.close()
