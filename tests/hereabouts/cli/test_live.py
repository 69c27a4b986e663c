"""`hereabouts live` from a growing folder and a Foxglove peer: ended, killed, started again."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hereabouts.cli import main
from kg.serving.opening import open_map
from tests.waiting import HEREABOUTS

Prints = Callable[..., str]


def frames_applied(path: Path) -> int:
    with open_map(path, read_only=True) as semantic_map:
        return sum(record.frames_applied for record in semantic_map.recordings())


def objects(prints: Prints, path: Path) -> list[object]:
    rows = "SELECT ?x ?y ?e { ?o here:existence ?e ; here:x ?x ; here:y ?y } ORDER BY ?x ?y ?e"
    return list(json.loads(prints("ask", path, "-e", rows, "--format", "json")))


def test_a_package_that_does_not_load_is_said_with_the_library_it_lacks(
    fails: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "pyrealsense2.py"
    package.write_text('raise ImportError("libusb-1.0.so.0: cannot open shared object file")')
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "pyrealsense2", raising=False)
    said = fails("live", "realsense", "--into", tmp_path / "new.map")
    assert "pyrealsense2, which does not load: libusb-1.0.so.0" in said


def test_a_camera_without_a_driver_is_refused_with_what_works(fails, tmp_path):
    said = fails("live", "oak", "--into", tmp_path / "new.map")
    assert "no driver" in said and "ros2 launch" in said
    assert not (tmp_path / "new.map").exists()


def test_a_realsense_camera_that_is_none_is_refused(fails, tmp_path, monkeypatch):
    rs = pytest.importorskip("pyrealsense2", reason="needs the extra realsense")
    into, junk = tmp_path / "new.map", tmp_path / "junk.db3"
    junk.write_bytes(b"no recording" * 1000)
    pipe = tmp_path / "pipe.db3"
    os.mkfifo(pipe)
    cases = {
        "realsense:012345": "neither a file (No such file or directory) nor the serial number",
        f"realsense:{tmp_path}": "it is no regular file",
        f"realsense:{pipe}": "it is no regular file",
        f"realsense:{junk}": "junk.db3 is no .db3 of librealsense",
    }
    if not len(rs.context().query_devices()):
        cases["realsense"] = "no RealSense camera is connected; realsense:FILE.db3"
    for source, said in cases.items():
        assert said in fails("live", source, "--into", into)
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    assert "pip install 'hereabouts[realsense]'" in fails("live", "realsense", "--into", into)
    assert not into.exists()


@pytest.fixture
def played_room(shared: Callable[[str], Path], tmp_path: Path) -> Path:
    """A recording of librealsense, 40 images in six seconds."""
    pytest.importorskip("rosbags")
    rs = pytest.importorskip("pyrealsense2", reason="needs the extra realsense")
    if not hasattr(rs.context, "convert_bag_to_db3"):
        pytest.skip("this pyrealsense2 writes .bag")
    from perception.sources.recording import open_recording
    from perception.sources.recording_options import RecordingOptions, Selection
    from tests.perception.sources.librealsense_recorder import record

    options = RecordingOptions(check=False, selection=Selection(limit=40))
    frames = list(open_recording(shared("data/rgbd/icl_livingroom"), options).frames())
    path = tmp_path / "room.db3"
    record(path, [(frame.rgb, frame.depth) for frame in frames], frames[0].K, pause=0.15)
    return path


def test_a_realsense_recording_is_mapped_as_it_is_played(played_room, prints, fails, tmp_path):
    into = tmp_path / "room.map"
    report = json.loads(prints("live", f"realsense:{played_room}", "--into", into, "--json"))
    assert 0 < report["frames"] <= report["tracked"] <= report["received"] <= 40
    assert report["frames"] == frames_applied(into)
    with open_map(into, read_only=True) as semantic_map:
        (recording,) = semantic_map.recordings()
    assert "while the camera was live" in recording.pose_estimate
    before = frames_applied(into), objects(prints, into)
    assert "neither a file" in fails("live", "realsense:absent.db3", "--into", into)
    assert before == (frames_applied(into), objects(prints, into))


def test_what_was_mapped_stays_where_a_realsense_camera_is_unplugged(
    played_room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from perception.sources.live.realsense import RealSenseCamera

    opened, seen, over = list[RealSenseCamera](), tmp_path / "seen", threading.Event()
    real = RealSenseCamera.at
    monkeypatch.setattr(
        RealSenseCamera, "at", lambda source: opened.append(real(source)) or opened[-1]
    )

    def unplug() -> None:
        while not over.wait(0.05):
            if opened and opened[0].device.as_playback().get_position() > 4.5e9:  # [ns]
                opened[0].device.as_playback().pause()
                break
        while not over.wait(0.05):
            if list(seen.glob("*")):
                opened[0].context.unload_device(str(played_room))
                break

    thread = threading.Thread(target=unplug)
    thread.start()
    words = ["live", f"realsense:{played_room}", "--into", tmp_path / "x.map", "--pictures", seen]
    code = main([str(word) for word in words])
    over.set()
    thread.join()
    assert code == 1
    assert capsys.readouterr().err.splitlines()[-1].endswith("the camera was unplugged")
    assert frames_applied(tmp_path / "x.map") >= 1


@pytest.mark.parametrize(
    "words", [["nowhere"], ["ftp://host"], ["ros1://"], ["ros1://h:port"], ["ros3"]]
)
def test_what_is_no_source_is_refused_before_a_map_is_made(words, fails, tmp_path):
    into = tmp_path / "new.map"
    assert "ros1://" in fails("live", *words, "--into", into)
    assert not into.exists()


def test_a_growing_folder_makes_the_map_of_the_finished_one(kitchen, kitchen_map, prints, tmp_path):
    growing, into = tmp_path / "growing" / "kitchen", tmp_path / "live.map"
    growing.mkdir(parents=True)
    for path in kitchen.glob("*.txt"):
        if "frame" not in path.name:
            shutil.copy(path, growing)
    numbers = sorted(path.name[:12] for path in kitchen.glob("*.color.*"))

    def add(number: str) -> None:
        for path in sorted(kitchen.glob(f"{number}.*")):
            whole = path.read_bytes()
            with (growing / path.name).open("wb") as file:  # a reader may see half of it
                file.write(whole[: len(whole) // 2])
                file.flush()
                time.sleep(0.01)
                file.write(whole[len(whole) // 2 :])

    def write() -> None:
        for number in numbers:
            add(number)
            time.sleep(0.05)

    writer = threading.Thread(target=write)
    writer.start()
    report = json.loads(prints("live", growing, "--into", into, "--idle", 5, "--json"))
    writer.join()
    assert report["frames"] == len(numbers) == 8
    assert objects(prints, into) == objects(prints, kitchen_map) != []
    again = json.loads(prints("map", growing, "--into", into, "--json"))
    assert (again["frames"], again["skipped"]) == (0, 8)


@contextmanager
def live(source: str, into: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    command = [*HEREABOUTS, "live", source, "--into", str(into), *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_live_is_ended_killed_and_started_again(kitchen: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("websockets")
    from perception.sources.bag_writer import COLOUR, DEPTH
    from perception.sources.bags.bag_file import BagFile
    from tests.perception.sources.live.foxglove_peer import foxglove_peer

    assert main(["convert", str(kitchen), "-o", str(tmp_path / "kitchen.mcap")]) == 0
    with BagFile(tmp_path / "kitchen.mcap") as bag:
        raws = list(bag.messages([topic.name for topic in bag.topics]))
    into = tmp_path / "live.map"
    topics = [COLOUR, DEPTH, "/tf", "/tf_static"]

    def play(until: Callable[[], bool]) -> None:
        while not until():
            for raw in raws:
                peer.publish(raw)
                if raw.topic == DEPTH:
                    time.sleep(0.1)
                if until():
                    return

    with foxglove_peer({raw.topic: raw.type for raw in raws}, "cdr") as peer:
        with live(peer.address, into, "--limit", "3", "--json") as process:
            peer.wait_for(topics)
            play(lambda: process.poll() is not None)
            report = json.loads(process.communicate()[0])
        assert process.returncode == 0
        assert report["frames"] == 3 == frames_applied(into)
        lost = [report[k] for k in ("dropped", "without_depth", "without_pose", "unreadable")]
        assert report["received"] == 3 + sum(lost)

        peer.hang_up()
        with live(peer.address, into, "--pictures", str(tmp_path / "seen")) as process:
            peer.wait_for(topics)
            play(lambda: len(list(tmp_path.glob("seen/*"))) >= 2)
            process.kill()
        killed = frames_applied(into)
        assert killed >= 5

        peer.hang_up()
        with live(peer.address, into, "--json", "--pictures", str(tmp_path / "more")) as process:
            peer.wait_for(topics)
            play(lambda: len(list(tmp_path.glob("more/*"))) >= 2)
            process.send_signal(signal.SIGTERM)
            report = json.loads(process.communicate()[0])
        assert process.returncode == 0
        assert frames_applied(into) == killed + report["frames"]


def test_live_without_a_frame_fails_and_makes_no_map(tmp_path, capsys):
    pytest.importorskip("rosbags")
    pytest.importorskip("websockets")
    from tests.perception.sources.live.foxglove_peer import foxglove_peer

    with foxglove_peer({"/tf": "tf2_msgs/msg/TFMessage"}, "cdr") as peer:
        assert main(["live", peer.address, "--into", str(tmp_path / "x.map"), "--idle", "1"]) == 1
    assert "has no colour images" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "x.map").exists()
