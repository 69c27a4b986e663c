"""Files for a robot: launch files, options and layouts name what there is."""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from hereabouts.cli import main
from tests.waiting import HEREABOUTS

pytest.importorskip("yaml")
import yaml

from hereabouts.display.viewers.ros_messages import LIVE_TOPICS, TOPICS
from hereabouts.display.viewers.topic_viewer import published_types
from kg.model.records import MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import create_map

FOLDER = Path(__file__).parents[1] / "docs/how-to/robot"


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The launch file, with the few names of ROS' launch that it uses."""
    plain = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, **how: (name, how),
            "ExecuteProcess": lambda **how: how,
            "OpaqueFunction": lambda function: function,
        },
        "launch.substitutions": {
            "LaunchConfiguration": lambda name: SimpleNamespace(perform=lambda given: given[name])
        },
    }
    for name, members in plain.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("launched", FOLDER / "hereabouts.launch.py")
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_the_launch_file_runs_live_by_options_that_there_are(launch, tmp_path, capsys):
    *declared, function = launch.generate_launch_description()
    given = {name: how["default_value"] for name, how in declared}
    (process,) = function({**given, "into": str(tmp_path / "a.map"), "source": "nowhere"})
    program, *words = process["cmd"]
    assert program == "hereabouts"
    assert words[:2] == ["live", "nowhere"] and "--publish" in words and "object/1" in words
    assert main(words) == 1  # all options are understood, and the source is none
    assert "'nowhere' is no source of frames" in capsys.readouterr().err


def test_the_options_that_wait_for_their_use_are_options() -> None:
    text = (FOLDER / "hereabouts.yaml").read_text()
    names = re.findall(r"^#? ?([a-z-]+): ", text, re.M)
    assert yaml.safe_load(text).keys() <= set(names) and len(names) > 5
    known = subprocess.run(
        [*HEREABOUTS, "live", "--help"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert all(f"--{name} " in known for name in names)


def test_layouts_draw_the_topics_that_are_published() -> None:
    published = set(published_types(is_ros1=False)) | set(TOPICS) | set(LIVE_TOPICS)
    foxglove = json.loads((FOLDER / "foxglove.json").read_text())
    drawn = set(foxglove["configById"]["3D!hereabouts"]["topics"])
    assert {"/map", "/hereabouts/markers", "/hereabouts/surface"} <= drawn <= published
    for path in (FOLDER / "hereabouts.rviz", FOLDER.parent / "hereabouts.rviz"):
        displays = yaml.safe_load(path.read_text())["Visualization Manager"]["Displays"]
        topics = [one.get("Topic", one.get("Marker Topic")) for one in displays]
        topics = {one["Value"] if isinstance(one, dict) else one for one in topics if one}
        assert {"/hereabouts/floor", "/hereabouts/markers", "/hereabouts/surface"} <= topics
        assert topics - {"/plan"} <= published


@pytest.mark.skipif(shutil.which("roslaunch") is None, reason="no ROS 1 here: ros-core")
def test_the_launch_file_of_ros_1_is_one() -> None:
    words = ["roslaunch", "--args", "hereabouts_live", str(FOLDER / "hereabouts.launch")]
    done = subprocess.run(
        [*words, "into:=/tmp/a.map"], capture_output=True, text=True, timeout=60, check=True
    )
    assert "exec hereabouts live ros1 --into /tmp/a.map --publish" in done.stdout


def test_the_node_of_a_behaviour_tree_asks_as_the_command_answers(tmp_path, capsys):
    text = (FOLDER / "where_to_look.cpp").read_text()
    (words,) = re.findall(r"start\(\{(.+?)\}\)", text, re.S)
    given = re.findall(r'"([^"]+)"', words)  # those between program, map and object
    assert given == ["program", "find", "--json", "--"]
    path = tmp_path / "a.map"
    with create_map(path) as semantic_map:
        kind = semantic_map.catalogue.find("dining room", "place").iri
        area = 3.0, 8.0, 6.0, 10.0
        room = PlaceRecord(semantic_map.place_iri(1), "dining room", *area, 20, {kind: 0.9})
        robot = RobotRecord(np.array([4.7, 8.2, 0.0]), 0.0, 1.0)
        semantic_map.apply(MapUpdate(places=(room,), robot=robot))
    assert main(["find", str(path), "--json", "--", "dining table"]) == 0
    (step, *_) = json.loads(capsys.readouterr().out)["steps"]
    keys = set(re.findall(r'step\.at\("(\w+)"\)', text))
    assert keys == {"x", "y", "heading", "probability"} and keys <= step.keys()
    ports = set(re.findall(r'putPort<[^;]*?>\("(\w+)"', text))
    (node,) = ElementTree.parse(FOLDER / "look_for_cup.xml").iter("WhereToLook")
    assert {"map", "object"} <= set(node.keys()) <= ports
