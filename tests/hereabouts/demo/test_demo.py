import json
import math
import multiprocessing
import shutil
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
import rdflib

from hereabouts.cli import build_parser, main
from hereabouts.demo.demo_search import in_short
from hereabouts.demo.house_demo import STAGES, TARGET, DemoProgress, DemoReport, make_room, run_demo
from kg.model.errors import GraphError, MapBusyError
from kg.serving.opening import create_map, open_map
from planner.simulation.house import furnished_house
from planner.simulation.house_robot import SimulatedHouseRobot, TimedPose


@pytest.fixture(scope="module")
def heard() -> list[DemoProgress]:
    return []


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, heard: list[DemoProgress]) -> DemoReport:
    """The whole demo, once, in a process of its own, whose memory is measured."""
    spawn = multiprocessing.get_context("spawn")
    folder = tmp_path_factory.mktemp("demo")
    with ProcessPoolExecutor(1, mp_context=spawn) as process, spawn.Manager() as manager:
        progress = manager.list()
        result = process.submit(run_demo, folder, progress.append).result()
        heard.extend(progress)
    return result


def test_the_map_is_on_disk_and_can_be_asked_again(report: DemoReport) -> None:
    with open_map(report.map_path, read_only=True) as semantic_map:
        assert len(semantic_map.objects()) >= report.mapping.objects
        food = semantic_map.query("objects-by-category", category="food").records()
        assert {row["category"] for row in food} >= {"banana", "cake"}
        (recording,) = semantic_map.recordings()
        assert recording.frames_applied == report.mapping.frames


def test_the_search_is_in_the_map_as_a_command_would_have_left_it(report: DemoReport) -> None:
    with open_map(report.map_path, read_only=True) as semantic_map:
        (search,) = semantic_map.searches.all()
        assert (search.words, search.state) == ((TARGET,), "found")
        assert search.seconds == pytest.approx(report.search.outcome.seconds, abs=0.1)
        assert len(semantic_map.searches.looks(search.iri)) == report.search.outcome.looks
        (apple,) = [o for o in semantic_map.objects(TARGET) if o.iri in search.found]
        robot = semantic_map.robot()
        assert robot is not None and robot.stamp == search.ended
        assert apple.last_seen <= robot.stamp


def test_the_map_is_good(report: DemoReport) -> None:
    score = report.score
    assert score.recall is not None and score.precision is not None
    assert score.position_error_median is not None
    assert score.recall > 0.85
    assert score.precision > 0.9
    assert [score.per_class[label].mapped for label in ("bed", "dining table")] == [1, 1]
    assert score.position_error_median < 0.2
    assert report.rooms_right >= report.rooms - 1


def test_the_search_leaves_no_phantoms(report: DemoReport) -> None:
    before, after = report.score, report.searched
    assert None not in (before.recall, before.precision, after.recall, after.precision)
    assert (after.recall or 0) > (before.recall or 0)
    assert (after.precision or 0) > (before.precision or 0) - 0.06
    assert after.per_class[TARGET].matched == 1


def test_the_three_questions_have_answers(report: DemoReport) -> None:
    assert len(report.answers) == 3
    assert all(answer.table.rows for answer in report.answers)
    in_kitchen = {row["category"] for row in report.answers[2].table.records()}
    assert {"oven", "microwave", "banana"} <= in_kitchen


def test_the_plan_reasons_with_what_apples_are_near(report: DemoReport) -> None:
    plan = report.planned.plan
    kinds = {reason.candidate.kind for step in plan.steps for reason in step.why}
    assert kinds >= {"nearby", "place"}
    assert any("near banana" in fact for r in plan.steps[0].why for fact in r.candidate.facts)
    assert plan.expected_seconds is not None


def test_find_takes_the_options_the_demo_tells(report: DemoReport) -> None:
    words = ["find", str(report.map_path), TARGET, *report.planned.options.split()]
    arguments = build_parser().parse_args(words)
    hello = SimulatedHouseRobot(furnished_house(), TimedPose(3.0, 3.0, 0.0, 0.0)).hello
    assert arguments.speed == hello.speed and arguments.recall == hello.recall
    assert hello.turn_rate is not None
    assert arguments.turn_rate == pytest.approx(math.degrees(hello.turn_rate), abs=0.1)
    assert arguments.range == (hello.near, hello.far)


def test_the_apple_is_found_where_it_was_put(report: DemoReport) -> None:
    assert report.search.found
    assert report.position_error is not None and report.position_error < 0.3
    assert report.hidden_in == "dining room"
    assert report.search.outcome.seconds > 0 and report.search.distance > 0
    assert report.search.events[-1].kind == "end"


def test_each_event_is_told_in_one_line(report: DemoReport) -> None:
    told = [line for _, line in in_short(report.search.events)]
    assert any("found near banana (60 %)" in line for line in told)
    assert all(line and "\n" not in line and "thesis" not in line for line in told)


def test_the_results_are_there_within_the_memory(report: DemoReport) -> None:
    graph = rdflib.Graph().parse(report.export_path)
    assert len(graph) == pytest.approx(report.triples, rel=0.01)
    assert report.picture_path.read_bytes().startswith(b"\x89PNG")
    assert main(["check", str(report.map_path)]) == 0
    assert 100 < report.peak_memory < 1000


def test_progress_is_told_stage_by_stage(report: DemoReport, heard: list[DemoProgress]) -> None:
    stages = list(dict.fromkeys(progress.stage for progress in heard))
    assert stages == list(STAGES)
    frames = [progress.done for progress in heard if progress.stage == "map"]
    assert frames == list(range(1, report.mapping.frames + 1))
    assert all(progress.done <= progress.total for progress in heard)


def test_the_report_is_plain_json(report: DemoReport) -> None:
    plain = json.loads(json.dumps(report.to_json()))
    assert plain["search"]["found"] is True
    assert plain["score"].keys() == plain["score_after_search"].keys()
    assert plain["score_after_search"]["per_class"][TARGET]["mapped"] >= 1
    assert plain["search"]["looks"] >= plain["search"]["explored_in_vain"]
    assert plain["plan"]["target"] == TARGET
    assert plain["answers"][0]["rows"][0]["category"] in ("banana", "cake")


def test_an_earlier_demo_is_cleared_away(report: DemoReport, tmp_path: Path) -> None:
    shutil.copytree(report.map_path.parent, tmp_path / "again")
    make_room(tmp_path / "again")
    assert not (tmp_path / "again" / "demo.map").exists()


@pytest.mark.parametrize("written", ["assertion", "title", "file", "map.ttl", "map.png"])
def test_what_a_person_added_to_a_demo_stays_until_told(report, tmp_path, written):
    folder = tmp_path / "again"
    shutil.copytree(report.map_path.parent, folder)
    if written in ("assertion", "title"):
        with open_map(folder / "demo.map") as semantic_map:
            if written == "title":
                semantic_map.describe(licence="https://example.org/mine", by="ann")
            else:
                semantic_map.assertions.add("object/1", "label", "mine", by="ann")
    else:
        path = folder / ("demo.map/notes.txt" if written == "file" else written)
        path.write_text("mine")
    with pytest.raises(GraphError, match=r"so it stays; .*--folder.*--replace removes it"):
        make_room(folder)
    assert (folder / "demo.map" / "store" / "CURRENT").exists()
    make_room(folder, replace=True)
    assert not (folder / "demo.map").exists()


def test_a_map_of_somebody_else_stays(tmp_path: Path) -> None:
    create_map(tmp_path / "demo.map", title="years of work").close()
    with pytest.raises(GraphError, match="was not made by the demo, so it stays"):
        run_demo(tmp_path)
    with open_map(tmp_path / "demo.map") as semantic_map:
        assert semantic_map.description.title == "years of work"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("demo.map/notes.txt", r"demo\.map was not made by the demo"),
        ("map.ttl", "map.ttl lies there without the demo's demo.map"),
        ("map.png", "map.png lies there without the demo's demo.map"),
    ],
)
def test_files_of_somebody_else_stay(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(GraphError, match=said):
        run_demo(tmp_path)
    assert (tmp_path / name).read_text() == "mine"


def test_a_link_is_not_followed(report: DemoReport, tmp_path: Path) -> None:
    (tmp_path / "demo.map").symlink_to(report.map_path)
    with pytest.raises(GraphError, match="was not made by the demo"):
        make_room(tmp_path)
    assert report.map_path.exists()


def test_a_map_in_use_is_not_pulled_away(report: DemoReport) -> None:
    with open_map(report.map_path), pytest.raises(MapBusyError):
        make_room(report.map_path.parent)
