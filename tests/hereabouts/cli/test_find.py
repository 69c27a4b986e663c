"""`hereabouts find` as people use it: steps, reasons, pictures, wrong words."""

import json
import math
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from hereabouts.cli import main
from tests.planner.flat import flat_map


@pytest.fixture(scope="module")
def flat_on_disk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flat_map(tmp_path_factory.mktemp("find") / "flat.map")


Said = Callable[..., tuple[str, str]]
ANSWERS: dict[tuple[str, ...], tuple[str, str]] = {}  # of the same flat, by the words


@pytest.fixture
def says(capsys: pytest.CaptureFixture[str], flat_on_disk: Path) -> Said:
    """Callable: run `find` on the flat, once for the same words; returns stdout and stderr."""

    def run(*words: object) -> tuple[str, str]:
        asked = tuple(map(str, words))
        if asked not in ANSWERS:
            capsys.readouterr()
            assert main(["find", str(flat_on_disk), *asked]) == 0
            ANSWERS[asked] = capsys.readouterr()
        return ANSWERS[asked]

    return run


def test_the_command_prints_steps_and_what_to_expect(says: Said) -> None:
    out, err = says("cup", "bed", "--from", "6,1,90", "--budget", "10min", "--speed", "0.5")
    assert "kitchen" in out and "place 1" not in out
    assert "bed" in out
    assert re.search(r"These looks find \d\.\d of 2, ", out) and not err


def test_what_is_known_comes_before_the_plan(says: Said) -> None:
    out, _ = says("cup", "--now", "map")
    assert out.startswith("Probably in the kitchen: cup 2 was seen there ")
    assert re.search(r"\(\d\d % sure\)", out.splitlines()[0])
    assert out.index("cup 2 was") < out.index("chance")
    (known,) = json.loads(says("cup", "--json")[0])["known"]
    assert known["existence"] >= 0.5
    assert known["last_seen"].startswith("1970-01-01T00:00:00")


def test_the_map_may_stand_last_or_be_the_only_one_here(
    flat_on_disk, tmp_path, capsys, monkeypatch
):
    def told(*words: str, code: int = 0) -> tuple[str, str]:
        assert main(list(words)) == code
        return capsys.readouterr()

    first, _ = told("find", str(flat_on_disk), "cup", "--now", "map")
    assert told("find", "cup", "--now", "map", str(flat_on_disk))[0] == first
    for command in ("status", "log", "why"):  # a label needs no quotes
        assert told(command, "cup", "2", str(flat_on_disk)) == told(
            command, str(flat_on_disk), "cup 2"
        )
    (flat_on_disk.parent / "kg" / "store").mkdir(parents=True)  # as in a clone: no map
    monkeypatch.chdir(flat_on_disk.parent)
    assert told("find", "cup", "--now", "map") == (first, "map: flat.map\n")
    assert "no map at other.map" in told("find", "other.map", "cup", code=1)[1]
    for command in ("find", "status", "ask"):
        assert "no map at other.map" in told(command, "cup", "other.map", code=1)[1]
    (tmp_path / "b.map").symlink_to(flat_on_disk)
    (tmp_path / "a.map").symlink_to(flat_on_disk)
    monkeypatch.chdir(tmp_path)
    assert "give one of the maps here: a.map, b.map" in told("ask", "where is the cup?", code=1)[1]
    with pytest.raises(SystemExit, match="2"):  # what changes a map asks for it
        main(["retract", "object/1"])


def test_now_is_now_unless_a_time_is_given(says: Said) -> None:
    today = json.loads(says("cup", "--json")[0])
    assert today["answer"][0].startswith("Probably no longer in the kitchen: cup 2 was seen")
    there = r"last \d\d years ago \(still there with 0 %, in the same room with \d\d? %\)"
    assert re.search(there, today["answer"][0])
    assert "lies before the last frame of the map" in says("cup", "--now", "1969-01-01")[1]
    then = json.loads(says("cup", "--json", "--now", "1970-01-01T00:10:00Z")[0])
    assert today["known"][0]["still_there"] < 0.01 < 0.85 < then["known"][0]["still_there"]


def test_a_plan_ends_where_looks_gain_too_little(says: Said) -> None:
    answers = [
        json.loads(says("cup", "--now", "map", "--json", *worth)[0])
        for worth in ((), ("--worth", "0.1"), ("--worth", "0.001"))
    ]
    usual, few, many = ([step["probability"] for step in one["steps"]] for one in answers)
    assert len(few) < len(usual) < len(many)
    assert min(usual) >= 0.02 and min(few) >= 0.1
    for one, after in pairwise(answers[2]["steps"]):
        assert [one[k] for k in ("x", "y", "heading")] != [after[k] for k in ("x", "y", "heading")]


@pytest.mark.parametrize("word", ["cup", "apple", "bed", "giraffe"])
def test_an_answer_has_less_than_ten_lines(says: Said, word: str) -> None:
    out, _ = says(word, "--worth", "0.001")
    lines = [line for line in out.splitlines() if line.strip()]
    assert 2 < len(lines) < 10
    looks = len(json.loads(says(word, "--worth", "0.001", "--json")[0])["steps"])
    assert looks <= 3 or f"; {looks - 3} more look" in lines[-1]


def test_what_is_not_known_is_said_with_what_was_viewed(says: Said) -> None:
    out, _ = says("apple")
    assert out.startswith("No apple is in the map, but nobody looked: the robot viewed ")
    first = json.loads(says("apple", "--json")[0])["steps"][0]
    rooms = {1: "the kitchen", 2: "the bedroom"}
    stand, shown = (rooms[int(iri[-1])] for iri in (first["place"], first["why"][0]["place"]))
    where = f"in {stand}" if stand == shown else f"from {stand} into {shown}"
    assert out.splitlines()[0].endswith(f"; the first look is {where}")


def test_each_reason_is_printed_once(says: Said) -> None:
    out, _ = says("apple")
    reasons = [line for line in out.splitlines() if " % of the chance: " in line]
    assert len(reasons) == len(set(reasons)) > 0


def test_looks_worth_nothing_are_not_listed(says: Said) -> None:
    out, _ = says("giraffe")
    assert "Not worth looking: it is on this floor with a chance of " in out
    assert " not found yet" not in out
    hint = re.findall(r"`hereabouts find (\S+) (.*)` plans", out)[0]
    assert " not found yet" in says(*hint[1].split())[0]


def test_steps_have_the_way_to_them_as_it_is_driven(says: Said) -> None:
    answer = json.loads(says("cup", "--json")[0])
    stop, driven = answer["start"], 0.0
    for step in answer["steps"]:
        way = step["way"]
        assert math.dist(way[0], stop) < 0.2
        assert math.dist(way[-1], (step["x"], step["y"])) < 0.01
        driven += sum(math.dist(a, b) for a, b in pairwise(way))
        stop = way[-1]
    assert driven == pytest.approx(answer["steps"][-1]["distance"], rel=0.15)


def test_the_table_says_why_without_the_sources(says: Said) -> None:
    out, _ = says("apple")
    assert "apple is found near banana (60 %)" in out
    assert "thesis 3.4.1" not in out
    assert "thesis 3.4.1" in says("apple", "--explain")[0]


def test_a_robot_that_turns_faster_expects_to_find_sooner(says: Said) -> None:
    slow = json.loads(says("apple", "--turn-rate", "9", "--json")[0])
    fast = json.loads(says("apple", "--turn-rate", "90", "--json")[0])
    assert fast["expected_seconds"] < slow["expected_seconds"]


def test_the_command_explains_each_step(says: Said) -> None:
    out, _ = says("apple", "--explain")
    assert "apple is found near banana" in out
    assert " remain." in out
    reasons = re.findall(r"^ +\d\S* %  (.*)", out, re.MULTILINE)
    full = [each for each in reasons if not re.search("facts at step|further reasons", each)]
    assert len(full) == len(set(full)) < len(reasons)  # later steps refer to the first


def test_the_command_draws_the_plan(says: Said, tmp_path: Path) -> None:
    says("cup", "--picture", tmp_path / "plan.svg")
    drawn = (tmp_path / "plan.svg").read_text()
    for text in ("flat: where to look for cup", "seen by the looks", "route"):
        assert f"<!-- {text} -->" in drawn


def test_the_floor_may_come_from_a_file(says: Said, tmp_path: Path) -> None:
    rows = [[254] * 80 for _ in range(30)]
    rows[14] = [0] * 80  # a wall right through: whoever starts below it sees nothing above it
    pixels = bytes(value for row in rows for value in row)
    (tmp_path / "floor.pgm").write_bytes(b"P5\n80 30\n255\n" + pixels)
    yaml = tmp_path / "floor.yaml"
    yaml.write_text("image: floor.pgm\nresolution: 0.2\norigin: [-2, -1, 0]\nnegate: 0\n")
    with_file = json.loads(says("cup", "--from", "1,0", "--grid", yaml, "--json")[0])
    without = json.loads(says("cup", "--from", "1,0", "--json")[0])
    assert with_file["steps"]
    assert all(step["y"] < 2.2 for step in with_file["steps"])
    assert with_file["probability"] != without["probability"]


def test_json_keeps_the_goals_and_adds_steps(says: Said) -> None:
    answer = json.loads(says("apple", "--json", "--now", "map")[0])
    assert answer["target"] == "apple"
    assert {goal["kind"] for goal in answer["goals"]} == {"nearby", "place"}
    visited = [goal["seconds"] for goal in answer["goals"] if goal["seconds"] is not None]
    assert visited == sorted(visited)
    left = [step["left"] for step in answer["steps"]]
    assert left == sorted(left, reverse=True)
    chances = sum(step["probability"] for step in answer["steps"])
    assert chances + left[-1] == pytest.approx(answer["present"], abs=1e-3)
    assert [step["seconds"] for step in answer["steps"]] == sorted(
        step["seconds"] for step in answer["steps"]
    )
    assert answer["steps"][0]["why"][0]["facts"]


def test_the_thesis_rule_is_still_there(says: Said) -> None:
    near = json.loads(says("cup", "--rule", "nearest-first", "--json")[0])
    assert [goal["kind"] for goal in near["goals"]] == ["known", "place"]


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["something to fly with"], "drink from"),
        (["cup", "bed", "--rule", "nearest-first"], "one object at a time"),
        (["cup", "--rule", "nearest-first", "--at", "now", "--recall", "1"], "--recall and --now"),
        (["cup", "--picture", "plan.doc"], ".png"),
        (["cup", "--at", "noon"], "moment"),
        (["cup", "--grid", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_what_cannot_be_done_is_one_line(flat_on_disk, capsys, words, error):
    assert main(["find", str(flat_on_disk), *words]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert error in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "words", [["--range", "4,1"], ["--recall", "2"], ["--budget", "soon"], ["--speed", "1e-9"]]
)
def test_wrong_numbers_are_wrong_usage(flat_on_disk: Path, words: list[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["find", str(flat_on_disk), "cup", *words])


def test_a_thing_that_no_detector_sees_is_an_answer(says: Said) -> None:
    said, _ = says("keys")
    assert said.startswith(
        "No detector here can see things called 'keys'. They are usually on a table"
    )
    both = json.loads(says("keys", "cup", "--json")[0])
    assert both["targets"] == ["cup"]
    (keys,) = both["undetectable"]
    assert (keys["target"], keys["synset"], keys["source"]) == ("keys", "key.n.01", "stated")
    assert json.loads(says("wallet", "--json")[0])["targets"] == []


def test_words_that_are_one_name_or_need_are_one_without_quotes(says: Said) -> None:
    def targets(*words: str) -> object:
        return json.loads(says(*words, "--json")[0])["targets"]

    assert targets("coffee", "mug") == targets("coffee mug") == ["cup"]
    assert targets("something", "to", "sit", "on") == targets("something to sit on")
    assert targets("cup", "bed") == ["cup", "bed"]
