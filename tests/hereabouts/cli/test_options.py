"""Each option of a command that maps or searches reaches the value that it is for."""

import argparse
import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hereabouts.cli import build_parser, main
from hereabouts.cli.mapping_options import mapping_options, network_options
from hereabouts.cli.recording_options import recording_options, source_options
from hereabouts.cli.ros_connections import ros_options
from hereabouts.cli.search import search_options
from kg.serving.opening import open_map
from mapping.looks.user_encoder import listed_words
from tests.encoder_files import write_colour_pair
from tests.hereabouts.cli.test_serve import Process

#: Option -> words of its value, the value in `Built` that it sets, and what that is then.
MAPPING: dict[str, tuple[list[str], str, Any]] = {
    "--mode": (["reference"], "mapping.mode", "reference"),
    "--labels-map": (["labels.csv"], "mapping.labels.names", {"mug": "cup"}),
    "--unknown-labels": (["ignore"], "mapping.reference.unknown_labels", "ignore"),
    "--places": (["places.csv"], "mapping.layout.places.0.label", "hall"),
    "--places-from-objects": ([], "mapping.reference.places_from_objects", True),
    "--no-places-from-objects": ([], "mapping.reference.places_from_objects", False),
    "--floor": ([], "mapping.occupancy", True),
    "--no-floor": ([], "mapping.occupancy", False),
    "--no-pictures": ([], "mapping.pictures", False),
    "--surface": (["5"], "mapping.surface", 0.05),
    "--encoder": (["mine/image.onnx,mine/text.onnx"], "mapping.encoder.name", "mine"),
    "--detector": (["other.onnx"], "networks.detector", "other.onnx"),
    "--second-detector": (["other.onnx"], "networks.second_detector", "other.onnx"),
    "--threshold": (["0.3"], "mapping.objects.min_score", 0.3),
    "--device": (["cuda"], "networks.device", "cuda"),
    "--head": (["yolov8"], "networks.head", "yolov8"),
    "--scene": (["other.onnx"], "networks.scene", "other.onnx"),
}
TOPICS: dict[str, tuple[list[str], str, Any]] = {
    "--intrinsics": (["K.txt"], "topics.intrinsics.fx", 500.0),
    "--depth-scale": (["1234"], "topics.depth_scale", 1234.0),
    "--color-topic": (["/c"], "topics.streams.colour", "/c"),
    "--depth-topic": (["/d"], "topics.streams.depth", "/d"),
    "--info-topic": (["/i"], "topics.streams.camera", "/i"),
    "--pose-topic": (["/p"], "topics.streams.pose", "/p"),
    "--pose-frame": (["base"], "topics.streams.pose_frame", "base"),
    "--camera-frame": (["lens"], "topics.streams.camera_frame", "lens"),
    "--camera-in": (["base=0,0,1,0,0,0"], "topics.streams.camera_in", "base=0,0,1,0,0,0"),
    "--map-frame": (["earth"], "topics.streams.map_frame", "earth"),
    "--tolerance": (["0.5"], "topics.streams.tolerance", 0.5),
}
SOURCE: dict[str, tuple[list[str], str, Any]] = {
    **{o: (w, at.replace("topics.", "reading."), v) for o, (w, at, v) in TOPICS.items()},
    "--format": (["tum"], "reading.format", "tum"),
    "--name": (["hall"], "reading.name", "hall"),
    "--pose-convention": (["ros"], "reading.pose_convention", "ros"),
    "--no-check": ([], "reading.check", False),
    "--registered": ([], "reading.registered", True),
    "--bgr": ([], "reading.bgr", True),
    "--up": (["z"], "reading.up", "z"),
    "--same-frame": ([], "mapping.same_frame", True),
}
RECORDING: dict[str, tuple[list[str], str, Any]] = {
    **SOURCE,
    "--poses": (["poses.txt"], "reading.poses", Path("poses.txt")),
    "--disparity": (["0.12"], "reading.disparity", 0.12),
    "--every": (["3"], "reading.selection.every", 3),
    "--keyframes": ([], "reading.selection.keyframes", True),
    "--limit": (["7"], "reading.selection.limit", 7),
    "--started": (["2020-01-01T00:00:00Z"], "reading.start_time", 1577836800.0),
    "--from": (["1.5"], "reading.selection.start", 1.5),
    "--to": (["2.5"], "reading.selection.stop", 2.5),
    "--transform": (["worlds.json"], "reading.T_map_world.0.3", 5.0),
    "--sequence": (["b", "--transform", "worlds.json"], "reading.T_map_world.0.3", 6.0),
    "--align": ([], "given.align", True),
}
SEARCH: dict[str, tuple[list[str], str, Any]] = {
    **TOPICS,
    "--budget": (["9 min"], "search.budget", 540.0),
    "--give-up-at": (["0.3"], "search.give_up_at", 0.3),
    "--patience": (["10"], "search.timeout", 10.0),
    "--detector": (["other.onnx"], "ros1.networks.detector", "other.onnx"),
    "--threshold": (["0.3"], "ros1.networks.threshold", 0.3),
    "--device": (["cuda"], "ros1.networks.device", "cuda"),
    "--labels-map": (["labels.csv"], "search.labels.names", {"mug": "cup"}),
    "--navigation": (["/drive"], "ros1.navigation", "/drive"),
    "--base-frame": (["trunk"], "ros1.base", "trunk"),
}
#: Options of each command itself, which belong to no value; their own tests are elsewhere.
_MAP = {"--into", "--pictures", "--mcap", "--rerun", "--base", "--power-safe", "--keep", "--json"}
OWN = {
    "map": {*_MAP, "--again"},
    "live": {*_MAP, "--limit", "--idle", "--publish", "--publish-tf", "--camera", "--loops"},
    "serve": {
        *("--host", "--port", "--token-file", "--read-token-file", "--public-host", "--public"),
        *("--allow-origin", "--allow-service", "--timeout", "--foxglove", "--keep", "--verbose"),
        *("--recording", "--trusted-proxy"),
    },
    "evaluate map": {
        *("--recording", "--truth", "--near", "--compare", "--sessions", "--picture", "--plot"),
        "--json",
    },
    "search": {"--robot", "--resume", "--hide", "--seed", "--mcap", "--rerun", "--json"},
}
FIXED = {
    "map": ["a", "--into", "a.map"],
    "live": ["a", "--into", "a.map"],
    "serve": ["a.map", "--recording", "a"],
    "evaluate map": ["--recording", "a", "--truth", "truth.json"],
    "search": ["a.map", "cup", "--robot", "ros1"],
}
TABLES = {
    "map": {**RECORDING, **MAPPING},
    "live": {**SOURCE, **MAPPING},
    "serve": {**RECORDING, **MAPPING},
    "evaluate map": {**RECORDING, **MAPPING},
    "search": SEARCH,
}


# making it takes most of the time of reading a line
parser_of_all = functools.cache(build_parser)


def options_of(command: str) -> set[str]:
    """The options that the command's own parser declares."""
    parser = parser_of_all()
    for word in command.split():
        (below,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        parser = below.choices[word]
    return {o for action in parser._actions for o in action.option_strings} - {"-h", "--help"}


CASES = [
    pytest.param(command, option, id=f"{command} {option}")
    for command in TABLES
    for option in sorted(options_of(command) - OWN[command])
]


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Callable: a command and words -> the values of its options, by their names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "cache"))
    write_colour_pair(tmp_path / "mine", words=" ".join(listed_words()).split())
    (tmp_path / "labels.csv").write_text("mug,cup\n")
    (tmp_path / "places.csv").write_text("label,xmin,xmax,ymin,ymax\nhall,0,1,0,1\n")
    (tmp_path / "K.txt").write_text("500 0 320\n0 500 240\n0 0 1\n")
    worlds = {}
    for name, x in (("a", 5.0), ("b", 6.0)):
        T = np.eye(4)
        T[0, 3] = x
        worlds[name] = {"T_map_world": T.tolist()}
    (tmp_path / "worlds.json").write_text(json.dumps({"sequences": worlds}))

    def build(command: str, *words: str) -> dict[str, Any]:
        given = parser_of_all().parse_args([*command.split(), *FIXED[command], *words])
        if command == "search":
            ros1 = ros_options(given)
            return {"search": search_options(given), "ros1": ros1, "topics": ros1.topics}
        live = command == "live"
        return {
            "given": given,
            "mapping": mapping_options(given),
            "networks": network_options(given),
            "reading": source_options(given) if live else recording_options(given, "a"),
        }

    return build


def at(value: Any, path: str) -> Any:
    """The value at a path of fields, keys and indices, such as `reading.T_map_world.0.3`."""
    for name in path.split("."):
        if isinstance(value, dict):
            value = value[name]
        else:
            value = value[int(name)] if name.isdigit() else getattr(value, name)
    return value


@pytest.mark.parametrize("command", TABLES)
def test_every_option_is_listed(command: str) -> None:
    listed = {*TABLES[command], *OWN[command]}
    assert options_of(command) == listed


@pytest.mark.parametrize(("command", "option"), CASES)
def test_an_option_reaches_its_value(built: Any, command: str, option: str) -> None:
    words, path, expected = TABLES[command][option]
    after = at(built(command, option, *words), path)
    assert after == expected
    if option in ("--floor", "--places-from-objects"):  # these two say the default
        return
    try:
        before = at(built(command), path)
    except (AttributeError, TypeError):  # nothing was there
        return
    assert before != expected


@pytest.mark.parametrize("command", ["map", "live", "serve", "evaluate map"])
def test_a_threshold_counts_in_both_modes_and_in_the_detector(built: Any, command: str) -> None:
    least = {
        (mode, given): built(command, "--mode", mode, *given)["mapping"].min_score
        for mode in ("bayes", "reference")
        for given in ((), ("--threshold", "0.6"))
    }
    assert list(least.values()) == [0.2, 0.6, 0.4, 0.6]
    detector = built(command, "--threshold", "0.6")["networks"].threshold
    assert detector == pytest.approx(0.3)  # half: the mapper counts weaker ones for its report


def test_modes_differ_in_their_defaults(built: Any) -> None:
    for mode, here in (("bayes", True), ("reference", False)):
        options = built("map", "--mode", mode)["mapping"]
        assert options.reference.places_from_objects is here
        assert options.find_places is here
    assert built("map", "--mode", "reference", "--places", "found")["mapping"].find_places
    assert not built("map", "--no-floor")["mapping"].find_places


def test_serve_maps_a_recording_by_the_same_options_as_map(kitchen, shared, tmp_path):
    detector = shared("models/deimv2_femto_416.onnx")
    options = ["--detector", detector, "--scene", "none", "--mode", "reference"]
    options = [*map(str, options), "--threshold", "0.5", "--no-floor", "--no-pictures"]
    options += ["--limit", "3"]
    assert main(["map", str(kitchen), "--into", str(tmp_path / "mapped.map"), *options]) == 0
    process = Process(tmp_path, tmp_path / "served.map", "--recording", kitchen, *options)
    try:
        while "done" not in str(process.get("health").json()["mapping"]):
            assert "failed" not in process.said.read_text()
    finally:
        assert process.end() == 0
    found = []
    for name in ("mapped.map", "served.map"):
        with open_map(tmp_path / name, read_only=True) as semantic_map:
            objects = semantic_map.objects()
            assert semantic_map.floor() == ()
        assert not (tmp_path / name / "detections.json").exists()  # bayes mode writes one
        label = semantic_map.catalogue.label
        found.append(sorted((label(o.category), o.confidence, *o.p_map) for o in objects))
    assert found[0] == found[1]
    assert found[0]
