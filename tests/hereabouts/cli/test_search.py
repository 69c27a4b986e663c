"""`hereabouts search`: exit codes, events, signals, kill -9 and going on after it."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from kg.model.records import MapUpdate, RecordingRecord
from kg.serving.opening import create_map, open_map
from planner.simulation.house_robot import DEMO_RECORDING
from tests.planner.point_robot import PointRobot
from tests.planner.robots import APPLE, FAR_APPLE, command, ring
from tests.waiting import HEREABOUTS


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "ring.map"
    with create_map(path) as semantic_map:
        ring(semantic_map)
    return path


def test_found_is_0_and_each_event_is_a_line_of_json(path, capsys):
    robot = f"stdio:{command(objects=[APPLE])}"
    assert main(["search", str(path), "apple", "--robot", robot, "--json"]) == 0
    out, err = capsys.readouterr()
    events = [json.loads(line) for line in out.splitlines()]
    kinds = [event["event"] for event in events]
    assert (kinds[0], kinds[-1]) == ("begin", "end")
    assert {"plan", "look", "found"} <= set(kinds)
    assert events[-1]["state"] == "found"
    assert err == ""
    plan = events[kinds.index("plan")]
    assert plan["why"]
    assert 0 < plan["probability"] < 1


def test_given_up_is_3_and_says_what_is_left(path, capsys):
    robot = f"stdio:{command()}"
    assert main(["search", str(path), "apple", "--robot", robot]) == 3
    out, err = capsys.readouterr()
    assert out.startswith("given up after ")
    assert "it is still there with " in out
    assert err.splitlines()[-1].endswith(out.strip())
    assert main(["ask", str(path), "searches"]) == 0
    assert "given up" in capsys.readouterr().out


def test_one_who_wants_less_certainty_gives_up_sooner(path, capsys):
    seconds = []
    for words in ([], ["--give-up-at", "0.3"]):
        robot = ["--robot", f"stdio:{command()}", "--json"]
        assert main(["search", str(path), "apple", *robot, *words]) == 3
        seconds.append(json.loads(capsys.readouterr().out.splitlines()[-1])["seconds"])
    assert seconds[1] < seconds[0]


def test_the_simulated_house_has_a_place_for_its_apple(path, capsys):
    words = ["--robot", "sim", "--hide", "apple", "--budget", "0.001"]
    assert main(["search", str(path), "apple", *words]) == 1
    assert "maps that `hereabouts demo` made" in capsys.readouterr().err
    with open_map(path) as semantic_map:
        toured = RecordingRecord(DEMO_RECORDING, 1, "frame-000000", np.eye(4))
        semantic_map.apply(MapUpdate(recording=toured))
    assert main(["search", str(path), "apple", *words]) == 3
    assert "the time budget is used up" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("how", "code", "state"), [("terminate", 143, "stopped"), ("kill", -9, "running")]
)
def test_cut_short_it_goes_on_where_its_last_look_ended(path, how, code, state, capsys):
    robot = f"stdio:{command(objects=[FAR_APPLE], at_look=3, then=how)}"
    words = ["search", str(path), "apple", "--robot", robot]
    cut = subprocess.run([*HEREABOUTS, *words], capture_output=True, check=False)
    assert cut.returncode == code
    with open_map(path, read_only=True) as semantic_map:
        (record,) = semantic_map.searches.all()
        assert record.state == state
        assert len(semantic_map.searches.looks(record.iri)) == 2
    robot = f"stdio:{command(objects=[FAR_APPLE])}"
    assert main(["search", str(path), "--resume", "--json", "--robot", robot]) == 0
    begin, *_, end = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert begin["looks"] == 2
    assert begin["left"] == pytest.approx(record.left, abs=1e-3)
    assert (end["search"], end["state"]) == (record.iri, "found")


def test_whoever_starts_it_can_be_the_robot(path: Path) -> None:
    point = PointRobot({"objects": [APPLE]})
    words = ["search", str(path), "apple", "--robot", "stdio"]
    with subprocess.Popen(
        [*HEREABOUTS, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for line in process.stdout:
            for message in point.handle(json.loads(line)):
                process.stdin.write(json.dumps(message) + "\n")
            process.stdin.flush()
        assert process.wait() == 0
    with open_map(path, read_only=True) as semantic_map:
        assert semantic_map.searches.all()[0].state == "found"


@pytest.mark.parametrize(
    "words",
    [
        ["--robot", "sim"],
        ["apple", "--robot", "tractor"],
        ["apple", "--robot", "stdio", "--json"],
        ["apple", "--robot", "stdio:true", "--hide", "cup@1,1,1"],
        ["apple", "--robot", "sim", "--budget", "0"],
    ],
)
def test_wrong_usage_is_2(path: Path, words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["search", str(path), *words])
    assert ended.value.code == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["apple", "--robot", "stdio:no-such-program-here"], "cannot start the robot"),
        (["apple", "--robot", "stdio:"], "needs a command to start"),
        (["apple", "--robot", "stdio:true"], "has ended with exit code 0"),
        (["apple", "--robot", "http://127.0.0.1:1"], "does not answer"),
        (["apple", "--resume", "--robot", "stdio:true"], "no unfinished search for apple"),
        (["aple", "--robot", "stdio:true"], "did you mean apple"),
        (["apple", "--robot", "sim", "--hide", "cup"], "LABEL@X,Y,Z in metres, e.g. cup@"),
        (["apple", "--robot", "sim", "--hide", "apple@nan,2,3"], "LABEL@X,Y,Z"),
        (["apple", "--robot", "sim", "--hide", "aple@1,2,3"], "did you mean apple"),
    ],
)
def test_errors_are_one_line_and_leave_the_map_alone(path, words, said, capsys):
    with open_map(path, read_only=True) as semantic_map:
        before = semantic_map.sequence
    assert main(["search", str(path), *words]) == 1
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert said in err
    with open_map(path, read_only=True) as semantic_map:
        assert semantic_map.sequence == before


def test_a_ros1_robot_that_is_not_there_is_an_error(path, capsys):
    pytest.importorskip("rosbags")
    for address in ("ros1://127.0.0.1:1", "ros1://"):
        words = ["--robot", address, "--patience", "0.5"]
        assert main(["search", str(path), "apple", *words]) == 1
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith("error: ")
        assert "ros1://" in error
    with open_map(path, read_only=True) as semantic_map:
        assert semantic_map.searches.all() == ()


def test_options_of_ros1_robots_are_for_them_alone(path, capsys):
    with pytest.raises(SystemExit):
        main(["search", str(path), "apple", "--robot", "sim", "--base-frame", "base_link"])
    assert "--base-frame needs --robot ros1://HOST" in capsys.readouterr().err
