"""`hereabouts live` with several cameras of one robot, whose publisher is another process."""

import json
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("cyclonedds")
pytest.importorskip("onnx")
import onnx

from benchmarks.search.orange_network import orange_network
from hereabouts.cli import main
from kg.serving.opening import open_map
from tests.perception.sources.live import two_cameras
from tests.perception.sources.live.ros1_master import fake_master
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK
from tests.waiting import HEREABOUTS, until


@pytest.fixture(params=["ros2", "ros1"])
def robot(request, tmp_path, monkeypatch):
    """Address of a robot with two cameras, of which a file `tmp_path`/rear stops one."""
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    with ExitStack() as stack:
        address = f"ros2://{DOMAIN}"
        if request.param == "ros1":
            address = stack.enter_context(fake_master()).address.address
        words = [sys.executable, two_cameras.__file__, address, str(tmp_path)]
        process = stack.enter_context(subprocess.Popen(words))
        stack.callback(process.kill)
        yield address


def test_two_cameras_make_one_map_and_one_that_dies_is_named(robot, tmp_path, capsys):
    onnx.save(orange_network(), tmp_path / "oranges.onnx")
    into, seen, errors = tmp_path / "a.map", tmp_path / "seen", tmp_path / "errors.txt"
    common = ["live", robot, "--into", str(into), "--camera", "front"]
    assert main([*common, "--camera", "raer"]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert (
        "there is no camera raer; did you mean rear?" in said and "/front/color/image_raw" in said
    )
    assert not into.exists()

    command = [*HEREABOUTS, *common, "--camera", "rear", "--json"]
    command += ["--scene", "none", "--detector", str(tmp_path / "oranges.onnx")]

    def pictures(camera: str) -> int:
        return len(list(seen.glob(f"{camera}-*")))

    with (
        errors.open("w") as file,
        subprocess.Popen(
            [*command, "--pictures", str(seen)], stdout=subprocess.PIPE, stderr=file, text=True
        ) as process,
    ):
        try:
            until(lambda: min(pictures("front"), pictures("rear")) >= 8)
            (tmp_path / "rear").touch()
            until(lambda: "camera rear: no frames: no colour images" in errors.read_text())
            before = pictures("front")
            until(lambda: pictures("front") >= before + 4)
            (tmp_path / "rear").unlink()
            until(lambda: "camera rear: frames come again, after" in errors.read_text())
            process.send_signal(signal.SIGINT)
            report = json.loads(process.communicate()[0])
        finally:
            process.kill()
    assert process.returncode == 0, errors.read_text()
    assert "camera front: no frames" not in errors.read_text()
    each = report["cameras"]
    assert {name: one["frames"] for name, one in each.items()} == {
        name: pictures(name) for name in ("front", "rear")
    }
    for name in ("frames", "received", "dropped"):
        assert report[name] == each["front"][name] + each["rear"][name]
    with open_map(into, read_only=True) as semantic_map:
        things = semantic_map.objects("orange", min_existence=0.5)
        frames = {one.evidence.frame.partition("-")[0] for one in things if one.evidence}
        found = sorted(tuple(one.p_map[:2]) for one in things)
        (recording,) = semantic_map.recordings()
    assert frames == {"front", "rear"}
    assert np.allclose(found, sorted([two_cameras.AHEAD[:2], two_cameras.BEHIND[:2]]), atol=0.1)
    assert recording.frames_applied == report["frames"]


@pytest.mark.parametrize(
    "words",
    [["."], ["ros2", "--color-topic", "/front/color"], ["ros2", "--detector", "topic:/yolo"]],
)
def test_what_is_of_one_camera_does_not_go_with_several(words, tmp_path, capsys):
    into = str(tmp_path / "a.map")
    with pytest.raises(SystemExit) as ended:
        main(["live", *words, "--into", into, "--camera", "front", "--camera", "rear"])
    assert ended.value.code == 2
    assert "camera" in capsys.readouterr().err
    assert not Path(into).exists()
