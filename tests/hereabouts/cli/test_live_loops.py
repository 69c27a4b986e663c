"""`hereabouts live --loops`: the map follows the SLAM of a robot that is another process."""

import json
import subprocess
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.waiting import HEREABOUTS

pytest.importorskip("rosbags")
pytest.importorskip("cyclonedds")
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map, open_map
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from planner.simulation.sensors import SimulatedDetector
from tests.perception.sources.live import drifting_robot
from tests.perception.sources.live.drifting_robot import BEGIN, FRAMES, HALF, LABELS, PERIOD
from tests.perception.sources.live.ros1_master import fake_master
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK

ASSERTED = "bowl"  # by someone, while the robot drives


@pytest.fixture
def robot(request, tmp_path, monkeypatch):
    """Address of the robot that drifts."""
    wire, told = request.param
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    with ExitStack() as stack:
        address = f"ros2://{DOMAIN}"
        if wire == "ros1":
            address = stack.enter_context(fake_master()).address.address
        (tmp_path / "seen").mkdir()
        words = [sys.executable, drifting_robot.__file__, address, told, str(tmp_path / "seen")]
        process = stack.enter_context(subprocess.Popen(words))
        stack.callback(process.kill)
        yield address


Things = list[tuple[str, np.ndarray]]  # category, and position (3,) [m]


@pytest.fixture(scope="module")
def truth() -> Things:
    """What the same images make of the first half's drive where their poses are true."""
    camera = drifting_robot.small_camera()
    detector, mount = SimulatedDetector(camera), camera.model.pose(0.0, 0.0, 0.0)
    with in_memory_map() as semantic_map:
        with Mapper(semantic_map, MappingOptions(surface=None)) as mapper:
            for n, T in enumerate(drifting_robot.drive()):
                frame = camera.frame(str(n), T @ mount, (BEGIN + n * PERIOD) / 1e9)
                mapper.add(frame, detector.detect(frame))
        return things(semantic_map)


def things(semantic_map: SemanticMap, frames: int = FRAMES) -> Things:
    """Things that are believed, whose evidence is of the first `frames`."""
    label = semantic_map.catalogue.label
    return [
        (label(one.category), one.p_map)
        for one in semantic_map.objects(min_existence=0.5)
        if one.evidence and (len(one.evidence.frame) < 9 or number(one.evidence.frame) < frames)
    ]


def number(frame: str) -> float:
    return (float(frame) * 1e9 - BEGIN) / PERIOD


def mapped(address: str, folder: Path, truth: Things, *words: str) -> tuple[dict, str, np.ndarray]:
    """Report, lines, and error [m] of each thing of the first half."""
    table = folder / "labels.csv"
    table.write_text("".join(f"{n},{label}\n" for n, label in enumerate(LABELS)))
    into = folder / "a.map"
    command = [*HEREABOUTS, "live", address, "--into", str(into)]
    command += ["--detector", "topic:/detections", "--scene", "none", "--limit", str(FRAMES)]
    command += ["--pictures", str(folder / "seen"), "--json", *words]
    if address.startswith("ros1"):
        command += ["--labels-map", str(table)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        asserted = asserted_meanwhile(into, folder / "seen") if words else {}
        output, lines = process.communicate(timeout=800)
    assert process.returncode == 0, lines
    with open_map(into, read_only=True) as semantic_map:
        found = things(semantic_map, HALF - 1)
        for iri, before in asserted.items():
            now = next(one for one in semantic_map.objects() if one.iri == iri)
            assert semantic_map.catalogue.label(now.category) == ASSERTED
            at = min((p for name, p in truth if name == before), key=partial(apart, now.p_map))
            assert apart(now.p_map, at) < 0.5
            assert [one.by for one in semantic_map.assertions.all()] == ["ann"]
    errors = [
        min((np.linalg.norm(p - q) for other, q in truth if other == name), default=np.nan)
        for name, p in found
    ]
    return json.loads(output), lines, np.array(errors)


def asserted_meanwhile(into: Path, seen: Path) -> dict[str, str]:
    """Someone calls the surest thing otherwise before the loop closes; its IRI and old category."""
    until = time.monotonic() + 300
    while len(list(seen.glob("*"))) < HALF // 2:
        assert time.monotonic() < until, "too few images were mapped"
        time.sleep(0.1)
    with open_map(into, read_only=True) as semantic_map:
        surest = max(semantic_map.objects(min_existence=0.5), key=lambda one: one.existence)
        label = semantic_map.catalogue.label(surest.category)
    command = [*HEREABOUTS, "assert", str(into), surest.iri, "category"]
    subprocess.run([*command, ASSERTED, "--by", "ann"], check=True, capture_output=True)
    return {surest.iri: label}


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one - other))


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        (("ros2", "tf"), ["--loops", "tf"]),
        (("ros2", "path"), ["--loops", "/slam/path"]),
        (("ros1", "graph"), ["--loops", "/slam/graph"]),
        (("ros2", "path"), []),
    ],
    indirect=["robot"],
    ids=["jump", "path", "graph", "none"],
)
def test_what_was_mapped_moves_with_the_corrected_path(robot, words, tmp_path, truth):
    report, lines, errors = mapped(robot, tmp_path, truth, *words)
    median, most = np.nanmedian(errors), np.nanpercentile(errors, 90)
    summary = f"{len(errors)} things, median {median:.3f} m, 90 % within {most:.3f} m"
    assert len(errors) >= 8
    if not words:
        assert "the path was corrected" not in lines
        assert median > 0.12 and most > 0.35, summary
        return
    assert report["corrections"] >= 1
    assert "the path was corrected by up to 0." in lines
    assert median < (0.08 if words[1] == "tf" else 0.05) and most < 0.35, summary
