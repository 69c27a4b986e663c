"""A second recording into a map: taken where it fits, refused where not, aligned where asked."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from kg.serving.opening import open_map
from perception.camera.poses import read_trajectory
from perception.sources.recording_writer import pose_line
from tests.hereabouts.cli.conftest import simulated

Prints = Callable[..., str]
Fails = Callable[..., str]


@pytest.fixture(scope="module")
def first_map(sessions: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    into = tmp_path_factory.mktemp("fit") / "first.map"
    assert main(["map", *_words(sessions[0], into)]) == 0
    return into


def _words(recording: Path, into: Path) -> list[str]:
    words = [str(recording), "--into", str(into), "--scene", "none", "--no-check"]
    return [*words, "--detector", "detections.json", "--places", "one"]


def _elsewhere(recording: Path, folder: Path) -> tuple[Path, np.ndarray]:
    """The recording with a world of its own: turned by 70 degrees, and moved."""
    shutil.copytree(recording, folder)
    M = np.eye(4)
    c, s = np.cos(np.radians(70)), np.sin(np.radians(70))
    M[:2, :2] = [[c, -s], [s, c]]
    M[:3, 3] = 2.0, -3.5, 0.0
    poses = read_trajectory(recording / "groundtruth.txt")
    lines = [pose_line(stamp, M @ poses.at(stamp, 0.0)) for stamp in poses.stamp]
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    return folder, M


def _state(address: Path) -> tuple[int, tuple[str, ...]]:
    with open_map(address, read_only=True) as semantic_map:
        return semantic_map.sequence, tuple(r.name for r in semantic_map.recordings())


def test_a_second_recording_of_the_same_world_is_taken(sessions, first_map, tmp_path, prints):
    into = shutil.copytree(first_map, tmp_path / "house.map")
    report = json.loads(prints("map", *_words(sessions[1], into), "--json"))
    assert "session-2 fits the map: " in report["fit"]
    assert _state(into)[1] == ("session-1", "session-2")


def test_one_with_a_world_of_its_own_is_refused_and_the_map_untouched(
    sessions: tuple[Path, Path], first_map: Path, tmp_path: Path, prints: Prints, fails: Fails
) -> None:
    into = shutil.copytree(first_map, tmp_path / "house.map")
    other, _ = _elsewhere(sessions[1], tmp_path / "other")
    before = _state(into)
    message = fails("map", *_words(other, into))
    assert "the transform from 'other' to this map of session-1 is unknown" in message
    assert all(way in message for way in ("--align", "--transform FILE", "--same-frame"))
    assert _state(into) == before
    prints("map", *_words(other, into), "--same-frame")
    assert _state(into)[1] == ("other", "session-1")


def test_it_is_aligned_where_asked_and_goes_on_there(sessions, first_map, tmp_path, prints):
    into = shutil.copytree(first_map, tmp_path / "house.map")
    other, M = _elsewhere(sessions[1], tmp_path / "other")
    prints("map", *_words(other, into), "--align")
    with open_map(into, read_only=True) as semantic_map:
        (found,) = [r.T_map_world for r in semantic_map.recordings() if r.name == "other"]
    off = found @ M  # the first recording's world is the map's, but for the height of the floor
    assert np.linalg.norm(off[:2, 3]) < 0.1
    assert abs(np.degrees(np.arctan2(off[1, 0], off[0, 0]))) < 1.0
    again = json.loads(prints("map", *_words(other, into), "--json"))
    assert again["frames"] == 0


def test_another_house_is_not_aligned(first_map, tmp_path, prints, fails):
    into = shutil.copytree(first_map, tmp_path / "house.map")
    other = simulated(tmp_path / "other", 5)
    before = _state(into)
    assert "'other' cannot be aligned" in fails("map", *_words(other, into), "--align")
    assert _state(into) == before


def test_align_and_transform_exclude_each_other(sessions, tmp_path):
    words = _words(sessions[0], tmp_path / "new.map")
    for other in (["--transform", str(sessions[0] / "transform.json")], ["--same-frame"]):
        with pytest.raises(SystemExit) as stop:
            main(["map", *words, "--align", *other])
        assert stop.value.code == 2


@pytest.fixture(scope="module")
def drifted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated(tmp_path_factory.mktemp("fit") / "drifted", 2, noise=0.03)


def _positions(address: Path) -> dict[str, np.ndarray]:
    with open_map(address, read_only=True) as semantic_map:
        return {o.iri.rsplit("/", 1)[1]: o.p_map for o in semantic_map.perceived.objects()}


def test_corrected_poses_move_what_was_mapped(drifted, tmp_path, prints):
    into, direct = tmp_path / "house.map", tmp_path / "direct.map"
    poses = ["--poses", str(drifted / "true_poses.txt")]
    prints("map", *_words(drifted, into))
    prints("map", *_words(drifted, direct), *poses)
    before = _positions(into)
    asserted = f"object/{next(iter(before))}"
    prints("assert", into, asserted, "category", "banana", "--by", "ann")
    sequence, _ = _state(into)
    report = json.loads(prints("map", *_words(drifted, into), *poses, "--json"))
    after, wanted = _positions(into), _positions(direct)
    assert _state(into)[0] == sequence + 1  # one transaction
    assert report["kept"] > len(before) / 2
    assert sum(iri in before for iri in after) >= report["kept"]
    for (
        p_map
    ) in wanted.values():  # what a map by these poses has, and nothing else but the asserted
        assert min(np.linalg.norm(p_map - q) for q in after.values()) < 0.02
    assert len(after) <= len(wanted) + 1
    with open_map(into, read_only=True) as corrected, open_map(direct, read_only=True) as other:
        assert [a.value for a in corrected.assertions.all()] == [
            corrected.catalogue.find("banana", kind="object").iri
        ]
        (ours,), (theirs,) = corrected.places(), other.places()
        assert ours.area == theirs.area
        floors = [
            {(t.column, t.row): t.cells for t in m.floor() if t.cells.any()}
            for m in (corrected, other)
        ]
        assert floors[0].keys() == floors[1].keys()
        assert all(np.array_equal(cells, floors[1][key]) for key, cells in floors[0].items())
        seen = [{*map(tuple, m.surface().points.tolist())} for m in (corrected, other)]
        assert len(seen[1]) > 1000 and seen[0] == seen[1]
        with corrected.at(sequence) as past:
            assert len(past.surface()) > 1000
            assert not {*map(tuple, past.surface().points.tolist())} <= seen[1]
    again = json.loads(prints("map", *_words(drifted, into), *poses, "--json"))
    assert (again["new"], again["removed"], again["median_distance"]) == (0, 0, 0)


def test_other_recordings_stay_where_poses_are_corrected(sessions, first_map, tmp_path, prints):
    into = shutil.copytree(first_map, tmp_path / "house.map")
    poses = read_trajectory(sessions[1] / "groundtruth.txt")
    wrong = tmp_path / "session-2"
    shutil.copytree(sessions[1], wrong)
    shift = np.eye(4)
    shift[0, 3] = 0.8
    lines = [pose_line(stamp, shift @ poses.at(stamp, 0.0)) for stamp in poses.stamp]
    (wrong / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    prints("map", *_words(wrong, into), "--same-frame")
    with open_map(into, read_only=True) as semantic_map:
        places = {p.label: p.area for p in semantic_map.places()}
        first = {
            o.iri: o.p_map
            for o in semantic_map.perceived.objects()
            if o.evidence is not None and o.evidence.recording == "session-1"
        }
    right = sessions[1] / "groundtruth.txt"
    prints("map", *_words(wrong, into), "--same-frame", "--poses", right)
    with open_map(into, read_only=True) as semantic_map:
        held = {o.iri: o.p_map for o in semantic_map.perceived.objects()}
        assert all(np.array_equal(held[iri], p_map) for iri, p_map in first.items())
        now = {p.label: p.area for p in semantic_map.places()}
    assert now["session-1"] == places["session-1"]
    assert now["session-2"] != places["session-2"]
