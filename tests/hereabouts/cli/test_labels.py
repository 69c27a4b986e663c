"""A detector with names of its own, on the command line: provisional categories and a table."""

import json
import shutil
from pathlib import Path

import pytest

from kg.serving.opening import open_map
from perception.inference.model_zoo import NETWORKS, default_model, model_path

OWN_NAMES = {"chair": "Windsor seat", "dining table": "Trestle board"}


@pytest.fixture
def detector(tmp_path: Path) -> Path:
    """The bundled detector in a folder of its own, with other names for two of its classes."""
    source = model_path(default_model("detector").name)
    shutil.copy(source, tmp_path)
    labels = (NETWORKS / "labels_coco80.txt").read_text(encoding="utf-8").splitlines()
    own = [OWN_NAMES.get(label, label) for label in labels]
    (tmp_path / f"{source.stem}.labels.txt").write_text("\n".join(own), encoding="utf-8")
    return tmp_path / source.name


def test_labels_of_a_detector_of_ones_own(kitchen, detector, tmp_path, prints):
    into = tmp_path / "kitchen.map"
    options = ("--detector", detector, "--scene", "none", "--threshold", "0.2", "--limit", 4)
    words = ("map", kitchen, "--no-check", "--json", *options, "--into")
    told = json.loads(prints(*words, into))
    assert "Windsor seat" in told["provisional"]
    assert told["unknown_labels"] == {}
    found = json.loads(prints("find", into, "windsor seats", "--json"))
    assert found
    asked = prints(
        "ask", into, "objects-by-category", "-p", "category=windsor seat", "--format", "json"
    )
    assert "Windsor seat" in asked
    with open_map(into, read_only=True) as semantic_map:
        seats = semantic_map.objects("windsor seat")
    assert seats
    prints("check", into)
    out = tmp_path / "ontology.ttl"
    prints("ontology", "export", into, "-o", out)
    assert "Windsor seat" in out.read_text(encoding="utf-8")

    table = tmp_path / "labels.csv"
    table.write_text("label,category\nWindsor seat,chair\nTrestle board,-\n", encoding="utf-8")
    again = tmp_path / "again.map"
    told = json.loads(prints(*words, again, "--labels-map", table))
    assert told["provisional"] == [] and told["unknown_labels"] == {}
    with open_map(again, read_only=True) as semantic_map:
        assert len(semantic_map.objects("chair")) == len(seats)
        assert semantic_map.objects("dining table") == ()


def test_labels_are_ignored_where_that_is_wanted(kitchen, detector, tmp_path, prints):
    options = ("--detector", detector, "--scene", "none", "--unknown-labels", "ignore")
    words = ("map", kitchen, "--no-check", "--limit", 4, "--json", *options)
    told = json.loads(prints(*words, "--into", tmp_path / "m"))
    assert told["provisional"] == []
    assert set(told["unknown_labels"]) <= set(OWN_NAMES.values())


def test_a_table_that_names_no_category_makes_no_map(kitchen, tmp_path, fails):
    table = tmp_path / "labels.csv"
    table.write_text("Windsor seat,chiar\n", encoding="utf-8")
    message = fails("map", kitchen, "--into", tmp_path / "m", "--labels-map", table)
    assert "did you mean chair" in message
    assert not (tmp_path / "m").exists()


def test_a_list_of_labels_is_checked_before_it_maps(tmp_path, prints, fails):
    path = tmp_path / "labels.txt"
    path.write_text("Chair\nsofa, couch, lounge\nArmchair\nWindsor seat\n", encoding="utf-8")
    found = json.loads(prints("models", "check", path, "--json"))
    assert [(one["way"], one["category"]) for one in found["labels"]] == [
        ("category", "chair"),
        ("name of a category", "couch"),
        ("new class", "chair"),
        ("provisional class", ""),
    ]
    assert "cup" in found["unseen"]
    assert "cannot read labels" in fails("models", "check", tmp_path / "none.txt")


def test_words_are_written_as_an_ontology(tmp_path, prints, fails):
    out = tmp_path / "mine.ttl"
    prints("ontology", "words", "keys", "kettle", "-o", out)
    assert "key.n.01" in out.read_text(encoding="utf-8")
    assert prints("ontology", "check", out) == ""
    every = tmp_path / "every.ttl"
    prints("ontology", "words", "-o", every)
    assert prints("ontology", "check", every) == ""  # no finding, not even a warning
    assert "no category 'qwzx'" in fails("ontology", "words", "qwzx")
