"""The gate for object mappers: stretches, their truths, what fails, and the command."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.rooms import houses, recordings
from benchmarks.rooms import outcomes as rooms_outcomes
from benchmarks.rooms.__main__ import main
from benchmarks.rooms.gate import report, violations
from benchmarks.rooms.houses import HOUSES
from benchmarks.rooms.outcomes import CLOSE, DEFAULT, REFERENCE, Outcome, evaluated, mean, scores
from benchmarks.rooms.stretches import STRETCHES, matcher_of, shown, stretches
from lab.houses.random_house import random_house
from lab.maps.complete_truth import TrueObject
from lab.maps.truth_matching import MappedObject, TruthMatcher
from lab.recordings.object_truth import VisibilityRecord, object_truth
from perception.frames import Frame
from perception.sources.recording_writer import RecordingWriter
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house_robot import SimulatedTour
from planner.simulation.sensors import SimulatedDetector

FRAMES = 12


def pose(x: float, degrees: float) -> np.ndarray:
    """A camera at (x, 0, 0) [m] that looks along +z, turned about y."""
    T, angle = np.eye(4), np.radians(degrees)
    T[[0, 2], [0, 2]], T[0, 2], T[2, 0] = np.cos(angle), np.sin(angle), -np.sin(angle)
    T[0, 3] = x
    return T


def test_stretches_are_where_the_camera_turns_and_stands() -> None:
    walk = [pose(0.5 * k, 0) for k in range(6)]
    turn = [pose(10, 30 * k) for k in range(9)]
    stand = [pose(20 + 0.01 * k, 2 * k) for k in range(5)]
    found = stretches(np.array([*walk, *turn, *stand]))
    assert {name for name, _ in found} == set(STRETCHES)
    parts = {name: list(indices) for name, indices in found}
    assert parts["turning"] == list(range(6, 15))
    assert parts["standing"] == list(range(15, 20))
    assert parts["first half"] + parts["second half"] == parts["whole"] == list(range(20))
    assert parts["backwards"] == parts["whole"][::-1]
    assert parts["every 4th"] == [0, 4, 8, 12, 16]
    assert [i for name, (i, *_) in found if name == "single"] == [2, 6, 10, 14, 18]


def test_a_short_turn_may_stray_farther() -> None:
    poses = np.array([pose(0.07 * k, 20 * k) for k in range(20)])
    turning = next(indices for name, indices in stretches(poses) if name == "turning")
    assert len(turning) == 9  # 0.28 m from their mean; within 0.2 m there are 6


def wall(depth: float, x: float = 0.0) -> Frame:
    """A wall at `depth` [m] before a camera at (x, 0, 0)."""
    K = np.array([[70.0, 0, 39.5], [0, 70.0, 29.5], [0, 0, 1]])
    image, measured = np.zeros((60, 80, 3), np.uint8), np.full((60, 80), depth, np.float32)
    return Frame("wall", image, measured, K, pose(x, 0), 0.0)


def test_an_object_is_shown_in_range_inside_the_image_and_unoccluded() -> None:
    points = [[0, 0, 2.2], [0, 0, 2.5], [0, 0, 0.3], [1.5, 0, 2.1], [0, 0, -2], [0.3, 0.2, 1.5]]
    assert shown(wall(2.0), np.array(points)).tolist() == [True, *[False] * 4, True]
    assert not shown(wall(9.0), np.array([[0, 0, 6.0]])).any()
    assert shown(wall(np.nan), np.array([[0, 0, 2.5]])).all()


def test_what_a_stretch_does_not_show_twice_counts_neither_way() -> None:
    truth = [TrueObject(str(x), "cup", np.array([x, 0.0, 2.0])) for x in (0.0, 1.5, 30.0)]
    frames = [wall(2.0), wall(2.0, 0.1), wall(2.0, 1.0)]

    def ignored(*some: Frame) -> list[bool]:
        return [t.ignore for t in matcher_of(some, truth, np.eye(4)).truth]

    assert ignored(*frames) == [False, True, True]
    assert ignored(frames[2]) == [True, False, True]


def outcome(row: tuple[str, str, str], mapper: str, *found: tuple[Any, ...]) -> Outcome:
    """Objects (x, existence, "cup" or another label) against true cups at 0 and 10 m."""
    truth = [TrueObject(str(x), "cup", np.array([x, 0.0, 0.0])) for x in (0.0, 10.0)]
    matcher = TruthMatcher(truth, np.eye(4))
    objects = [
        MappedObject(*(label or ["cup"]), np.array([x, 0.0, 0.0]), e) for x, e, *label in found
    ]
    close = TruthMatcher(truth, np.eye(4), CLOSE)
    return Outcome(
        row, mapper, 4, 0.1, evaluated(objects, matcher), evaluated(objects, close), unnamed=3
    )


RIGHT, GHOST = ((0.0, 1.0), (10.0, 1.0)), ((50.0, 0.04),)


def test_scores_of_objects_by_hand() -> None:
    row = ("kitchen", "net", "whole")
    one = scores([outcome(row, DEFAULT, (0.1, 0.9), (50, 0.8), (10, 0.4))])
    assert one["AP"] == pytest.approx(1 / 2 + (2 / 3) / 2)
    assert (one["recall"], one["precision"], one["error [m]"]) == (0.5, 0.5, 0.1)
    assert one["best F1"] == pytest.approx(0.8)
    assert one["ECE"] == pytest.approx((0.1 + 0.8 + 0.6) / 3)
    assert one["ms a frame"] == pytest.approx(25)
    none = scores([outcome(row, DEFAULT)])
    assert none["precision"] is None and none["AP"] == 0
    means = mean([one, none])
    assert (means["recall"], means["precision"]) == (0.25, 0.5)


def test_the_gate_fails_where_the_reference_wins() -> None:
    here, there, single = (("a", "net", s) for s in ("whole", "turning", "single"))
    same = [outcome(r, m, *RIGHT) for r in (here, there) for m in (DEFAULT, REFERENCE)]
    looks = [outcome(single, DEFAULT), outcome(single, REFERENCE, *RIGHT)]
    assert list(violations([*same, *looks])) == []  # single frames are apart
    lost = [outcome(("b", "net", "whole"), DEFAULT, *GHOST, RIGHT[0])]
    won = [outcome(("b", "net", "whole"), REFERENCE, *RIGHT)]
    assert list(violations([*same, *lost, *won])) == [
        "b, net: AP 0.500, the reference's is 1.000",
        "b, net: F1 within 0.3 m 0.667, the reference's is 1.000",
    ]
    assert list(violations([*same, *lost, outcome(("b", "net", "whole"), REFERENCE)])) == []


def test_the_gate_fails_where_the_reference_wins_within_a_narrow_reach() -> None:
    row = ("a", "net", "whole")
    beside = [(x + 0.4, e) for x, e in RIGHT]
    found = [outcome(row, DEFAULT, *beside), outcome(row, REFERENCE, RIGHT[0])]
    assert list(violations(found)) == ["a, net: F1 within 0.3 m 0.000, the reference's is 0.667"]


def test_names_and_doubles_are_counted_among_what_is_shown() -> None:
    row = ("a", "net", "whole")
    found = scores(
        [
            outcome(row, DEFAULT, (0.0, 0.9), (0.2, 0.8), (50.0, 0.9)),  # right, a double, a ghost
            outcome(row, DEFAULT, (0.4, 0.9), (10.0, 0.9, "bowl"), (0.1, 0.4, "bowl")),
        ]
    )
    names = ("right names", "doubles", "unnamed", "recall, 0.3 m", "precision, 0.3 m")
    assert [found[name] for name in names] == [pytest.approx(2 / 3, abs=1e-3), 1, 6, 0.25, 0.2]


def test_the_gate_fails_where_existence_is_badly_calibrated() -> None:
    row = ("a", "net", "whole")
    unsure = [(x, 0.6) for x, _ in RIGHT]
    found = [outcome(row, DEFAULT, *unsure), outcome(row, REFERENCE, *unsure)]
    assert list(violations(found)) == ["real rooms: ECE 0.400, at most 0.10"]


def test_the_gate_fails_where_houses_miss_their_goals() -> None:
    row = (HOUSES, "hard", "tour")
    good = [outcome(row, m, *RIGHT) for m in (DEFAULT, REFERENCE)]
    assert list(violations(good)) == []
    bad = [outcome(row, DEFAULT, (0.0, 1.0)), outcome(row, REFERENCE)]
    assert list(violations([*good, *bad])) == ["houses, hard senses: recall 0.750, at least 0.86"]


def test_the_report_has_a_row_for_each_stretch_and_the_means() -> None:
    rows = [("a", "net", stretch) for stretch in ("whole", "single")]
    lines = list(report([outcome(row, m, *RIGHT) for row in rows for m in (DEFAULT, REFERENCE)]))
    assert lines[2].startswith("| a | net | whole | 4 | 2 | 1.00 / 1.00 | 1.00 / 1.00 | 1.000 / ")
    assert [line.split(" | ")[2] for line in lines[2:5]] == ["whole", "single", "mean"]
    assert lines[-1] == "- reference, single looks: ECE 0.000, 95 % ellipse -"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SimulatedCamera]:
    """Shared data of one recording, the last frames of a tour, and its camera."""
    shared = tmp_path_factory.mktemp("shared")
    camera = SimulatedCamera(random_house(2), seed=2)
    tour = SimulatedTour(camera)
    visible = VisibilityRecord(camera.house, camera.model)
    folder = shared / "data/rgbd/small"
    folder.parent.mkdir(parents=True)
    with RecordingWriter(folder, up=(0, 0, 1)) as writer:
        for frame in islice(tour.frames(len(tour) - FRAMES), FRAMES):
            writer.add(frame)
            visible.add(frame.id, camera.view(frame.T_map_cam, frame.stamp))
    truth = object_truth(camera.house, visible.frames, [])
    (folder / recordings.TRUTH).write_text(json.dumps(truth))
    return shared, camera


@pytest.fixture
def gate(small, monkeypatch):
    """Callable: the command on the small recording, whose pair is two simulated detectors."""
    shared, camera = small
    monkeypatch.setenv("HEREABOUTS_SHARED", str(shared))
    monkeypatch.setattr(recordings, "load_detector", lambda *_, **__: SimulatedDetector(camera))
    recordings.frames_of.cache_clear()
    yield lambda *words: main([str(w) for w in (*words, "--seeds", "--processes", "1")])
    recordings.frames_of.cache_clear()


def test_networks_look_once(gate, tmp_path, monkeypatch, capsys):
    stretches = ("--stretches", "whole", "single")
    codes = [gate("--cache", tmp_path, *stretches)]
    first = capsys.readouterr().out
    assert len(list(tmp_path.iterdir())) == 2
    monkeypatch.delattr(recordings, "load_detector")
    codes.append(gate("--cache", tmp_path, *stretches))

    def values(out: str) -> list[list[str]]:
        return [line.split("|")[:-2] for line in out.splitlines()]  # but for milliseconds

    assert values(capsys.readouterr().out) == values(first)
    assert f"| small | default | whole | {FRAMES} |" in first
    assert "| small | default | single | 5 |" in first
    assert codes == [0 if "gate: passed" in first else 1] * 2


def test_the_command_fails_where_the_reference_wins(gate, monkeypatch, capsys):
    monkeypatch.setitem(rooms_outcomes._MIN_SCORE, DEFAULT, 1.0)  # it sees nothing
    assert gate("--stretches", "whole") == 1
    assert "- gate: small, default: AP 0.000, the reference's is " in capsys.readouterr().out


def test_a_house_is_mapped_by_both_mappers_with_each_of_the_senses(monkeypatch):
    class Short(SimulatedTour):
        def frames(self, start: int = 0) -> Iterator[Frame]:
            return islice(super().frames(start), 4 * FRAMES)

    monkeypatch.setattr(houses, "SimulatedTour", Short)
    found = houses.map_house(2)
    assert [(o.row, o.mapper) for o in found] == [
        ((HOUSES, senses, "tour"), mapper)
        for senses in ("demo", "hard")
        for mapper in (DEFAULT, REFERENCE)
    ]
    assert {o.frames for o in found} == {4 * FRAMES}
    assert len({o.evaluation.matcher.counted for o in found}) == 1
    assert (scores(found[:1])["AP"] or 0) > 0.5


def test_an_unknown_room_is_wrong_usage(gate, capsys):
    with pytest.raises(SystemExit, match="2"):
        gate("--rooms", "cellar")
    assert "no 'cellar'; there are: small" in capsys.readouterr().err
