"""`info`, `convert`, and maps of one recording as folder, ROS 1 bag, ROS 2 bag and MCAP file."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from pyoxigraph import RdfFormat, parse

from tests.hereabouts.cli.test_served_maps import untimed
from tests.kg.conftest import canonical

BASE = "https://example.org/kitchen/"

pytest.importorskip("rosbags")
Prints = Callable[..., str]
FRAMES, MAPPED = 12, 3


@pytest.fixture(scope="module")
def folder(shared: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first seconds of the real kitchen, every other frame."""
    source = shared("data/rgbd/redkitchen")
    made = tmp_path_factory.mktemp("bags") / "kitchen"
    made.mkdir()
    for number in range(0, 8 * FRAMES, 8):
        for suffix in ("color.jpg", "depthreg.png", "posecolor.txt"):
            shutil.copy(source / f"frame-{number:06d}.{suffix}", made)
    for name in ("color-intrinsics.txt", "gravity-direction.txt"):
        shutil.copy(source / name, made)
    return made


def mapped(prints: Prints, recording: Path, into: Path) -> set[str]:
    # floor is dated by the minute, and the recording has no clock
    words = ["map", recording, "--no-check", "--limit", MAPPED, "--into", into, "--base", BASE]
    words += ["--json", "--started", "2026-11-22T10:00:00Z", "--detector", "nanodet_g_416"]
    assert json.loads(prints(*words))["frames"] == MAPPED
    out = into.with_suffix(".ttl")
    prints("export", into, "-o", out)
    return canonical(parse(untimed(out.read_text()), format=RdfFormat.TURTLE, base_iri=BASE))


def test_folder_ros1_bag_ros2_bag_and_mcap_make_one_map(folder, prints, tmp_path):
    copies = {
        "ros1": tmp_path / "1" / "kitchen.bag",
        "ros2": tmp_path / "2" / "kitchen",
        "mcap": tmp_path / "3" / "kitchen.mcap",
    }
    for copy in copies.values():
        copy.parent.mkdir()
        prints("convert", folder, "-o", copy, "--limit", MAPPED)
    wanted = mapped(prints, folder, tmp_path / "maps" / "kitchen.map")
    assert len(wanted) > 1000
    for kind, copy in copies.items():
        found = mapped(prints, copy, tmp_path / f"maps-{kind}" / "kitchen.map")
        assert found == wanted, kind


def test_an_ending_that_convert_does_not_know_is_refused(folder, fails, tmp_path):
    told = fails("convert", folder, "-o", tmp_path / "kitchen.xyz")
    assert "unknown ending '.xyz'; .mcap (ROS 2), .bag (ROS 1) or no ending" in told
    assert list(tmp_path.iterdir()) == []


def test_info_shows_streams_choice_and_fit(folder, prints, fails, tmp_path):
    bag = tmp_path / "kitchen.mcap"
    prints("convert", folder, "-o", bag, "--limit", 6)
    told = json.loads(prints("info", bag, "--json"))
    uses = {stream["name"]: stream["use"] for stream in told["streams"]}
    assert uses["/camera/color/image_raw/compressed"] == "colour"
    assert uses["/camera/aligned_depth_to_color/image_raw"] == "depth"
    assert uses["/tf"] == "poses"
    assert uses["/camera/color/camera_info"] == "camera"
    assert told["frames"] == 6
    assert told["poses"] == "camera_color_optical_frame in world, from tf"
    text = prints("info", bag)
    assert "16UC1 640x480" in text
    assert "colour and depth within 0.02 s" in text
    again = json.loads(prints("info", bag, "--json", "--every", 2, "--to", 99))
    assert again["frames"] == 3

    of_folder = json.loads(prints("info", folder, "--json"))
    assert of_folder["frames"] == FRAMES
    assert of_folder["streams"][0]["count"] == FRAMES
    assert "no stamps: 30 a second are taken" in of_folder["streams"][0]["holds"]
    assert "agree" in of_folder["depth and poses"]


def test_info_of_a_bag_that_cannot_be_mapped_shows_its_streams(folder, prints, tmp_path, capsys):
    from hereabouts.cli import main

    bag = tmp_path / "kitchen.bag"
    prints("convert", folder, "-o", bag, "--limit", 3)
    assert main(["info", str(bag), "--map-frame", "moon"]) == 1
    out, err = capsys.readouterr()
    assert "/camera/color/camera_info" in out
    assert err.startswith("error: no transforms of frame 'moon'")


def test_commands_on_what_is_no_bag(fails, folder, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(b"\x89MCAP0\r\n" + bytes(99))
    for words in (
        ("info", torn),
        ("convert", torn, "-o", tmp_path / "x.mcap"),
        ("map", torn, "--into", tmp_path / "x.map"),
    ):
        assert f"{torn} cannot be read" in fails(*words)
    assert not (tmp_path / "x.map").exists()
    assert "bags and MCAP files only" in fails("info", folder, "--color-topic", "/rgb")
    kept = tmp_path / "kept.mcap"
    kept.write_text("mine")
    assert "exists already" in fails("convert", folder, "-o", kept, "--limit", 2)


def test_a_bag_that_is_damaged_in_the_middle_is_mapped_up_to_there(folder, tmp_path, capfd):
    from hereabouts.cli import main

    bag, into = tmp_path / "kitchen.bag", tmp_path / "kitchen.map"
    assert main(["convert", str(folder), "-o", str(bag), "--limit", "6"]) == 0
    whole = bag.read_bytes()
    images = [place for place in range(len(whole)) if whole.startswith(b"\x89PNG", place)]
    assert len(images) == 6
    damaged = bytearray(whole)
    damaged[images[3] + 5000] ^= 0xFF
    bag.write_bytes(damaged)
    words = ["map", str(bag), "--into", str(into), "--detector", "nanodet_g_416", "--json"]
    capfd.readouterr()
    assert main(words) == 1
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1 and "image_raw/compressed at 0.8" in err
    bag.write_bytes(whole)
    assert main(words) == 0
    again = json.loads(capfd.readouterr().out)
    assert (again["skipped"], again["frames"]) == (3, 3), "whole frames were kept"
