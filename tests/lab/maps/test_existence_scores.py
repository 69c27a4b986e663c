"""Scores against a complete truth: each rule by hand, and the data set's own scoring script."""

import csv
import json
import subprocess
import sys
from dataclasses import asdict

import numpy as np
import pytest

from kg.model.errors import RecordingError
from lab.maps.complete_truth import is_complete_truth, load_complete_truth
from lab.maps.existence_scores import matchings_by_existence, scores_by_existence
from lab.maps.truth_matching import MappedObject, TruthMatcher

IDENTITY = np.eye(4)


def write(tmp_path, **objects):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps({"objects": objects}))
    return path


def scores_of(objects, truth, near=0.5):
    matcher = TruthMatcher(truth, IDENTITY, near)
    return scores_by_existence(matchings_by_existence(objects, matcher), matcher)


def scored(tmp_path, truth, *mapped, near=0.5):
    """The score of all (label, x) objects against entries at y = z = 0."""
    entries = {
        name: {"cls": label, "position": [x, 0, 0], **more}
        for name, (label, x, more) in truth.items()
    }
    objects = [MappedObject(label, np.array([x, 0.0, 0.0])) for label, x in mapped]
    truth = load_complete_truth(write(tmp_path, **entries))
    return scores_of(objects, truth, near)[0]


def counts(score):
    kinds = ("matched", "duplicates", "wrong", "ghosts", "ignored")
    return {kind: getattr(score, kind) for kind in kinds if getattr(score, kind)}


def test_a_second_object_near_a_matched_one_is_a_duplicate(tmp_path):
    score = scored(tmp_path, {"a": ("cup", 0, {})}, ("cup", 0.1), ("cup", 0.4), ("cup", 0.6))
    assert counts(score) == {"matched": 1, "duplicates": 1, "ghosts": 1}
    assert (score.recall, score.precision, score.clean) == (1.0, 0.333, 0.5)
    assert score.error == 0.1


def test_other_names_count_as_right(tmp_path):
    truth = {"a": ("tv", 0, {"also": ["laptop"]})}
    assert counts(scored(tmp_path, truth, ("laptop", 0.1))) == {"matched": 1}
    assert counts(scored(tmp_path, truth, ("book", 0.1))) == {"wrong": 1}


def test_ignored_entries_count_neither_way(tmp_path):
    truth = {"a": ("cup", 0, {}), "doubtful": ("vase", 3, {"ignore": True})}
    score = scored(tmp_path, truth, ("cup", 0), ("vase", 3.1), ("vase", 3.3))
    assert counts(score) == {"matched": 1, "ignored": 2}
    assert (score.true, score.precision) == (1, 1.0)


def test_an_entry_may_have_a_reach_of_its_own(tmp_path):
    assert counts(scored(tmp_path, {"a": ("cup", 0, {"reach": 2.0})}, ("cup", 1.5)))["matched"] == 1
    assert "matched" not in counts(scored(tmp_path, {"a": ("cup", 0, {})}, ("cup", 1.5)))
    near = scored(tmp_path, {"a": ("cup", 0, {})}, ("cup", 0.4), near=0.3)
    assert counts(near) == {"ghosts": 1}


def test_labels_within_an_extended_thing_are_wrong_labels(tmp_path):
    truth = {"a": ("couch", 0, {"extent": [3.0, 1.0, 0.8]})}
    assert counts(scored(tmp_path, truth, ("suitcase", 1.4))) == {"wrong": 1}
    assert counts(scored(tmp_path, truth, ("suitcase", 1.6))) == {"ghosts": 1}


def test_nothing_mapped_and_nothing_true(tmp_path):
    assert scored(tmp_path, {"a": ("cup", 0, {})}).recall == 0.0
    assert counts(scored(tmp_path, {}, ("cup", 0))) == {"ghosts": 1}


def test_thresholds_leave_out_what_hardly_exists(tmp_path):
    truth = load_complete_truth(write(tmp_path, a={"cls": "cup", "position": [0, 0, 0]}))
    objects = [MappedObject("cup", np.zeros(3), 0.4), MappedObject("cup", np.ones(3), 0.9)]
    scores = scores_of(objects, truth)
    assert [score.mapped for score in scores] == [2, 2, 1, 1]
    assert [score.recall for score in scores] == [1.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize(
    "entry", [{"cls": "cup"}, {"cls": "cup", "position": [1, 2]}, "cup", {"position": [0, 0, 0]}]
)
def test_a_malformed_entry_is_named(tmp_path, entry):
    with pytest.raises(RecordingError, match=r"truth\.json, a: .*would work"):
        load_complete_truth(write(tmp_path, a=entry))


def test_which_truth_is_complete(tmp_path, shared):
    assert is_complete_truth(shared("data/rgbd/redkitchen/objects_full_gt.json"))
    assert not is_complete_truth(shared("data/rgbd/redkitchen/objects_gt.json"))
    assert not is_complete_truth(tmp_path / "nowhere.json")


@pytest.mark.parametrize("near", [0.5, 0.3])
def test_numbers_are_those_of_the_data_sets_own_script(tmp_path, shared, near):
    truth_file = shared("data/rgbd/redkitchen/objects_full_gt.json")
    truth = load_complete_truth(truth_file)
    rng = np.random.default_rng(7)
    labels = [t.label for t in truth] + ["suitcase", "laptop", "couch"]
    objects = [
        MappedObject(
            t.label if rng.random() < 0.6 else str(rng.choice(labels)),
            t.p_world + rng.normal(0, 0.3, 3),
            round(float(rng.random()), 2),
        )
        for t in truth
        for _ in range(int(rng.integers(0, 4)))
    ]
    table = tmp_path / "objects.csv"
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["category", "x", "y", "z", "existence"])
        writer.writerows([o.label, *map(float, o.p_map), o.existence] for o in objects)
    script = shared("data/rgbd/score_full.py")
    words = [script, table, truth_file, "identity", "--json", "--near", str(near)]
    done = subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, check=True, timeout=60
    )
    expected = json.loads(done.stdout)
    scores = scores_of(objects, truth, near)
    assert json.loads(json.dumps([asdict(score) for score in scores])) == expected
    assert all(expected[0][kind] for kind in ("matched", "duplicates", "wrong", "ghosts"))
