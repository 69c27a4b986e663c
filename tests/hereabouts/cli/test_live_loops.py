"""`hereabouts live --loops`: the map follows the SLAM of a robot that is another process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("cyclonedds")
from kg.serving.opening import open_map
from planner.simulation.houses.house import furnished_house
from tests.perception.sources.live import drifting_robot
from tests.perception.sources.live.drifting_robot import BEGIN, FRAMES, HALF, LABELS, PERIOD
from tests.perception.sources.live.ros1_master import fake_master
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def robot(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """Address of the robot that drifts."""
    wire, told = request.param
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    with ExitStack() as stack:
        address = f"ros2://{DOMAIN}"
        if wire == "ros1":
            address = stack.enter_context(fake_master()).address.address
        (tmp_path / "seen").mkdir()
        words = [sys.executable, drifting_robot.__file__, address, told, str(tmp_path / "seen")]
        process = stack.enter_context(subprocess.Popen(words))
        stack.callback(process.kill)
        yield address


def mapped(address: str, folder: Path, *words: str) -> tuple[dict, str, np.ndarray]:
    """Report, lines, and error [m] of each object of the first half's frames."""
    table = folder / "labels.csv"
    table.write_text("".join(f"{n},{label}\n" for n, label in enumerate(LABELS)))
    into = folder / "a.map"
    command = [sys.executable, "-m", "hereabouts.cli", "live", address, "--into", str(into)]
    command += ["--detector", "topic:/detections", "--scene", "none", "--limit", str(FRAMES)]
    command += ["--pictures", str(folder / "seen"), "--json", *words]
    if address.startswith("ros1"):
        command += ["--labels-map", str(table)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr
    truth = furnished_house().objects
    errors = []
    with open_map(into, read_only=True) as semantic_map:
        for one in semantic_map.objects(min_existence=0.5):
            label, seen = semantic_map.catalogue.label(one.category), one.evidence.frame
            if float(seen) * 1e9 < BEGIN + (HALF - 1) * PERIOD:
                same = [
                    np.linalg.norm(o.centre()[:2] - one.p_map[:2])
                    for o in truth
                    if o.label == label
                ]
                errors.append(min(same, default=np.nan))
    return json.loads(done.stdout), done.stderr, np.array(errors)


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
def test_what_was_mapped_moves_with_the_corrected_path(
    robot: str, words: list[str], tmp_path: Path
) -> None:
    report, lines, errors = mapped(robot, tmp_path, *words)
    print(report, lines, np.round(np.sort(errors), 3))
    assert len(errors) >= 8
    if not words:
        assert "corrected" not in lines and np.nanmedian(errors) > 0.15
        return
    assert report["corrections"] >= 1
    assert "the path was corrected by up to 0." in lines
    assert np.nanmedian(errors) < 0.06
