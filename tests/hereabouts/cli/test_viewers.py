"""What commands write for viewers, read again by the formats' own packages."""

import importlib.util
import json
import re
import signal
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader
from rosbags.rosbag1 import Reader
from websockets.sync.client import connect

from hereabouts.cli import main
from kg.maps.object_pictures import ObjectPictures
from kg.serving.opening import create_map, open_map
from mapping.places.layout import load_layout
from tests.planner.robots import FAR_APPLE, command, ring
from tests.waiting import HEREABOUTS


def topics(path: Path) -> Counter[str]:
    with path.open("rb") as file:
        return Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())


def test_mapping_is_kept_frame_by_frame(kitchen: Path, tmp_path: Path) -> None:
    mcap, rrd = tmp_path / "out.mcap", tmp_path / "out.rrd"
    words = ["map", str(kitchen), "--into", str(tmp_path / "k.map"), "--limit", "3"]
    assert main([*words, "--mcap", str(mcap), "--rerun", str(rrd)]) == 0
    seen = topics(mcap)
    assert seen["/camera/image/compressed"] == seen["/camera/camera_info"] == 3
    assert seen["/hereabouts/robot"] >= 2 and seen["/hereabouts/markers"] >= 1 and seen["/map"] >= 1
    entities = {str(chunk.entity_path) for chunk in RrdReader(rrd).stream().to_chunks()}
    assert {"/map/camera/image", "/map/objects/cubes", "/map/robot"} <= entities


def test_an_existing_file_is_refused_before_anything_is_mapped(kitchen, tmp_path, fails):
    (tmp_path / "out.mcap").write_text("mine")
    into = tmp_path / "k.map"
    assert "exists" in fails("map", kitchen, "--into", into, "--mcap", tmp_path / "out.mcap")
    assert not into.exists() and (tmp_path / "out.mcap").read_text() == "mine"


def test_a_search_is_kept_with_its_plans(tmp_path: Path) -> None:
    with create_map(tmp_path / "ring.map") as semantic_map:
        ring(semantic_map)
    out, robot = tmp_path / "out.mcap", f"stdio:{command(objects=[FAR_APPLE])}"
    words = ["search", str(tmp_path / "ring.map"), "apple", "--robot", robot, "--mcap", str(out)]
    assert main(words) == 0
    seen = topics(out)
    assert seen["/hereabouts/plan"] >= 2 and seen["/rosout"] >= 3 and seen["/hereabouts/robot"] >= 2


def test_each_format_is_written_and_replaces_what_was_there(lab: Path, tmp_path: Path) -> None:
    for name in ("m.mcap", "m.rrd", "m.bag", "m.geojson", "rooms.json"):
        (tmp_path / name).write_text("older")
        kind = ["--format", "json"] if name == "rooms.json" else []
        assert main(["export", str(lab), "-o", str(tmp_path / name), *kind, "--all"]) == 0
    assert topics(tmp_path / "m.mcap")["/hereabouts/markers"] == 1
    assert any("objects" in str(c.entity_path) for c in RrdReader(tmp_path / "m.rrd").stream())
    with Reader(tmp_path / "m.bag") as bag:
        assert "/hereabouts/markers" in bag.topics
    assert len(load_layout(tmp_path / "m.geojson").places) == len(
        json.loads((tmp_path / "rooms.json").read_text("utf-8"))["rooms"]
    )


def test_the_map_of_then_is_exported(lab: Path, tmp_path: Path) -> None:
    out = tmp_path / "rooms.json"
    for when, has_rooms in (("#0", False), ("#1", True)):
        assert main(["export", str(lab), "-o", str(out), "--format", "json", "--at", when]) == 0
        assert bool(json.loads(out.read_text("utf-8"))["rooms"]) is has_rooms


def test_pictures_of_objects_are_copied(kitchen_map, tmp_path, fails):
    out, folder = tmp_path / "rooms.json", tmp_path / "shots"
    with open_map(kitchen_map, read_only=True) as semantic_map:
        kept = {one.iri: ObjectPictures(kitchen_map).path_of(one) for one in semantic_map.objects()}
    assert (
        main(["export", str(kitchen_map), "-o", str(out), "--pictures", str(folder), "--all"]) == 0
    )
    copied = {path.stem: path.read_bytes() for path in folder.iterdir()}
    expected = {iri.rpartition("/")[2]: path.read_bytes() for iri, path in kept.items() if path}
    assert copied == expected and expected
    assert "is inside the folder of the map" in fails(
        "export", kitchen_map, "-o", out, "--pictures", kitchen_map / "shots"
    )


def test_what_cannot_be_written_is_one_line(lab, tmp_path, fails, monkeypatch):
    assert "cannot write" in fails("export", lab, "-o", tmp_path / "nowhere" / "m.mcap")
    assert "did you mean mcap" in fails("export", lab, "-o", tmp_path / "m", "--format", "mcapp")
    assert "--find needs one of" in fails("export", lab, "-o", tmp_path / "m.ttl", "--find", "cup")
    assert "no category 'bamama'" in fails(
        "export", lab, "-o", tmp_path / "m.bag", "--find", "bamama"
    )
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for name, extra in (("m.mcap", "foxglove"), ("m.rrd", "rerun"), ("m.bag", "ros")):
        says = fails("export", lab, "-o", tmp_path / name)
        assert f"pip install 'hereabouts[{extra}]'" in says
    assert not list(tmp_path.glob("m.*"))


def test_served_to_foxglove_until_it_ends(lab: Path, tmp_path: Path) -> None:
    serve = [*HEREABOUTS, "serve", str(lab), "--port", "0"]
    with subprocess.Popen([*serve, "--foxglove", "0"], stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        found = re.search(r"ws://127\.0\.0\.1:\d+", server.stderr.readline())
        assert found is not None
        with connect(found[0], subprotocols=["foxglove.sdk.v1"]) as client:  # type: ignore[list-item]
            assert json.loads(client.recv(timeout=30))["op"] == "serverInfo"
        server.stderr.readline()  # it answers over HTTP as well
        server.send_signal(signal.SIGTERM)
        assert server.wait(60) == 0


def test_a_private_map_is_not_served_to_foxglove(lab: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["serve", str(lab), "--foxglove", "0", "--read-token-file", str(tmp_path / "t")])
    assert ended.value.code == 2
