"""The commands of the tutorial without poses run, in their order."""

import re
import shlex
from pathlib import Path

PAGE = Path(__file__).resolve().parents[3] / "docs" / "tutorial" / "from-a-camera.md"
FRAMES = 10


def test_the_tutorial_runs_from_a_camera_to_an_answer(shared, tmp_path, prints, monkeypatch):
    source, folder = shared("data/rgbd/redkitchen"), tmp_path / "recordings" / "kitchen"
    folder.mkdir(parents=True)
    for path in sorted(source.glob("*.color.jpg"))[:FRAMES]:
        for kind in (".color.jpg", ".depthreg.png"):
            name = path.name.replace(".color.jpg", kind)
            (folder / name).symlink_to(source / name)
    (folder / "color-intrinsics.txt").symlink_to(source / "color-intrinsics.txt")
    monkeypatch.chdir(tmp_path)
    lines = re.findall(r"^    hereabouts (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    # ten frames hardly move, so a second recording cannot be recognised; no camera is live
    lines = [line for line in lines if "evening" not in line and not line.startswith("live")]
    said = {words[0]: prints(*words) for words in map(shlex.split, lines)}
    assert list(said) == ["info", "map", "check", "ask", "find"]
    assert "estimated: poses of" in said["info"]
    assert "chair" in said["map"]
    assert "object/" in said["ask"]
    assert "cup" in said["find"]
