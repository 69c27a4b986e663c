"""Killed at any moment, a map keeps every update it acknowledged, and every frame whole."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

from kg.serving.opening import open_map

ROOT = Path(__file__).resolve().parents[3]
ROUNDS = 4
OBJECTS = 10
WRITER = f"""
import sys
import numpy as np
from kg.model.records import MapUpdate, ObjectRecord, RecordingRecord
from kg.serving.opening import open_or_create_map

chart = open_or_create_map(sys.argv[1])
chair = chart.catalogue.find("chair").iri
frame = int(sys.argv[2])
while True:
    frame += 1
    objects = tuple(
        ObjectRecord(f"{{chart.base}}object/{{n}}", chair, np.array([frame % 97, n, 1.0]),
                     1.0, 0.5, frame, 0.0, float(frame))
        for n in range(1, {OBJECTS} + 1)
    )
    recording = RecordingRecord("run", frame, str(frame), np.eye(4))
    chart.apply(MapUpdate(objects=objects, recording=recording))
    print(frame, flush=True)
"""


def write_until_killed(path: Path, start: int, seconds: float) -> int:
    """The last frame that the killed child acknowledged."""
    child = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), str(start)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    first = child.stdout.readline()
    time.sleep(seconds)
    child.kill()
    rest = child.stdout.read()
    child.wait()
    child.stdout.close()
    whole = [line for line in (first + rest).splitlines(keepends=True) if line.endswith("\n")]
    return int(whole[-1])


def test_killed_writers_lose_nothing_they_acknowledged(tmp_path: Path) -> None:
    path, frame = tmp_path / "map", 0
    chance = random.Random(7)
    for _ in range(ROUNDS):
        acknowledged = write_until_killed(path, frame, chance.uniform(0.02, 0.3))
        with open_map(path, read_only=True) as chart:
            objects = chart.objects()
            (recording,) = chart.recordings()
        assert len(objects) == OBJECTS
        markers = {(o.observations, o.last_seen, o.p_map[0]) for o in objects}
        frame = recording.frames_applied
        assert markers == {(frame, float(frame), float(frame % 97))}
        # one more than was printed may have been written, never one less
        assert acknowledged <= frame <= acknowledged + 1
    assert frame > ROUNDS
