"""`hereabouts map` killed at any moment: whole frames stay, and the same command goes on."""

import json
import random
import signal
import sqlite3
import subprocess
import time
from contextlib import closing
from pathlib import Path

from kg.serving.opening import open_map
from tests.waiting import HEREABOUTS

FRAMES = 12


def _first_frames(source: Path, folder: Path) -> Path:
    """A recording of the first frames of another."""
    folder.mkdir()
    for path in source.glob("*.txt"):
        (folder / path.name).symlink_to(path)
    for color in sorted(source.glob("frame-*.color.*"))[:FRAMES]:
        for path in source.glob(f"{color.name.split('.')[0]}.*"):
            if not (folder / path.name).exists():
                (folder / path.name).symlink_to(path)
    return folder


def _start(recording: Path, into: Path) -> subprocess.Popen[bytes]:
    words = ["map", str(recording), "--no-check", "--into", str(into), "--json"]
    null = subprocess.DEVNULL
    return subprocess.Popen([*HEREABOUTS, *words], stdout=null, stderr=null)


def _written(path: Path) -> int:
    """How many transactions the log of a map being written holds so far."""
    try:
        with closing(sqlite3.connect(f"file:{path / 'history.sqlite'}?mode=ro", uri=True)) as log:
            ((count,),) = log.execute("SELECT count(*) FROM commits")
            return int(count)
    except sqlite3.OperationalError:  # not there yet, or not ready to be read
        return 0


def _frames_applied(path: Path) -> int:
    with open_map(path, read_only=True) as semantic_map:
        (record,) = semantic_map.recordings() or (None,)
        robot = semantic_map.robot()
        assert (record is None) == (robot is None)
        return record.frames_applied if record else 0


def test_killed_twice_then_finished(shared, tmp_path, prints):
    recording = _first_frames(shared("data/rgbd/redkitchen"), tmp_path / "kitchen")
    into = tmp_path / "kitchen.map"
    rng = random.Random(4)
    before = 0
    for _ in range(2):
        begun = _written(into)
        process = _start(recording, into)
        while _written(into) < begun + 2 and process.poll() is None:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.5))
        process.send_signal(signal.SIGKILL)
        process.wait()
        applied = _frames_applied(into)
        assert applied >= before
        before = applied
        assert prints("check", into) == ""
    assert 0 < before < FRAMES  # each run was killed after it had written something

    report = json.loads(prints("map", recording, "--no-check", "--into", into, "--json"))
    assert report["skipped"] == before
    assert report["frames"] == FRAMES - before
    assert _frames_applied(into) == FRAMES
    assert prints("check", into) == ""
