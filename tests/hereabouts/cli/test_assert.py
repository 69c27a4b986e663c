"""`hereabouts assert`, `retract` and `update`."""

import json
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.serving.opening import create_map, open_map


@pytest.fixture
def den(tmp_path: Path) -> Path:
    path = tmp_path / "den.map"
    with create_map(path, base="http://m/") as semantic_map:
        semantic_map.update("INSERT DATA { <http://m/object/1> a here:Cup ; here:x 1 ; here:y 2 }")
    return path


def rows(prints, den: Path, question: str) -> list[dict[str, object]]:
    return json.loads(prints("ask", den, question, "--format", "json"))


@pytest.mark.parametrize(
    ("words", "category"),
    [("coffee mug", "cup"), ("Weinglas", "wine glass"), ("sofa", "couch"), ("bowls", "bowl")],
)
def test_a_word_is_asserted_as_the_category_it_means(den, prints, words, category):
    prints("assert", den, "object/1", "category", words, "--by", "ann")
    assert [row["category"] for row in rows(prints, den, "objects")] == [category]


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ("office chair", "is a kind of chair; the category chair would work, or `hereabouts name"),
        ("bannana", "no object category 'bannana'"),
        ("kitchen", "that is a place"),
        ("kettle", "no object category 'kettle'"),
    ],
)
def test_a_word_of_no_category_is_refused_with_what_works(den, capsys, words, hint):
    assert main(["assert", str(den), "object/1", "category", words, "--by", "ann"]) == 1
    assert hint in capsys.readouterr().err


def test_a_thing_is_on_another_by_its_label(den: Path, prints) -> None:
    with open_map(den) as semantic_map:
        table = "<http://m/object/2> a here:DiningTable ; here:x 1 ; here:y 2"
        semantic_map.update(f"INSERT DATA {{ {table} }}")
    prints("assert", den, "object/2", "label", "big table", "--by", "ann")
    prints("assert", den, "object/1", "on", "big table", "--by", "ann")
    (row,) = rows(prints, den, "SELECT ?on WHERE { <object/1> here:on ?on }")
    assert row == {"on": "http://m/object/2"}


@pytest.mark.parametrize("text", ["x" * 10_000, "two\nlines", "a\u202eb", "a\x1b[31mb"])
def test_labels_and_authors_are_one_visible_line(den, capsys, text):
    for label, author in ((text, "ann"), ("cup", text)):
        assert main(["assert", str(den), "object/1", "label", label, "--by", author]) == 1
        error = capsys.readouterr().err
        assert "would work" in error or "has up to 100 characters" in error
        assert error.count("\n") == 1 and len(error) < 300


def test_what_is_said_is_believed_until_it_is_taken_back(den, prints, capsys):
    prints("assert", den, "object/1", "category", "wine", "glass", "--by", "ann")
    prints("assert", den, "object/1", "position", "3", "-1", "0.5", "--by", "ann")
    (row,) = rows(prints, den, "objects")
    assert (row["category"], row["x"], row["y"]) == ("wine glass", 3.0, -1.0)
    conflicts = rows(prints, den, "conflicts")
    assert {(c["property"], c["by"]) for c in conflicts} == {
        ("category", "ann"),
        ("position", "ann"),
    }
    for prop in ("category", "position"):
        assert main(["retract", str(den), "object/1", prop, "--by", "bob"]) == 0
    assert "has the value of perception; transaction" in capsys.readouterr().err
    (row,) = rows(prints, den, "objects")
    assert (row["category"], row["x"], row["y"]) == ("cup", 1.0, 2.0)


def test_what_was_said_is_told_as_json(den, prints):
    told = json.loads(
        prints("assert", den, "object/1", "category", "bowl", "--by", "ann", "--json")
    )
    sequence = told.pop("sequence")
    assert told == {
        "thing": "http://m/object/1",
        "property": "category",
        "value": "https://w3id.org/hereabouts#Bowl",
        "by": "ann",
        "perceived": "https://w3id.org/hereabouts#Cup",
        "contradicted": True,
        "changed": True,
    }
    (reason,) = json.loads(prints("why", den, "object/1 a", "--json"))
    assert reason["text"] == "bowl 1 is a bowl"
    assert reason["fact"][2] == "<https://w3id.org/hereabouts#Bowl>"
    told = json.loads(prints("retract", den, "object/1", "category", "--by", "ann", "--json"))
    assert told["changed"] and told["sequence"] == sequence + 1
    (row,) = json.loads(prints("ask", den, "objects", "--json"))
    assert row["category"] == "cup"


def test_relative_iris_are_those_of_the_map(den, prints):
    prints("update", den, "--by", "ann", "-e", "DELETE DATA { <object/1> a here:Bowl }")
    ask = ("ask", den, "--json", "-e", "SELECT ?x { <object/1> here:x ?x }")
    assert json.loads(prints(*ask)) == [{"x": 1.0}]
    prints("update", den, "--by", "ann", "-e", "DELETE WHERE { <object/1> ?p ?o }")
    assert json.loads(prints(*ask)) == []


def test_an_update_is_applied_from_the_line_or_a_file(den, prints, tmp_path):
    text = "INSERT DATA { <http://m/object/2> a here:Chair ; here:x 0 ; here:y 0 }"
    done = json.loads(prints("update", den, "-e", text, "--by", "ann", "--json"))
    assert done["sequence"] == 2
    assert done["added"] > 5
    file = tmp_path / "away.ru"
    file.write_text("DELETE WHERE { <http://m/object/2> ?p ?o }")
    prints("update", den, file)
    assert [row["category"] for row in rows(prints, den, "objects")] == ["cup"]


def test_what_is_refused_is_said_in_one_line(den, fails):
    assert "did you mean bowl" in fails("assert", den, "object/1", "category", "bowll", "--by", "a")
    assert "no object or place" in fails("assert", den, "object/7", "label", "x", "--by", "a")
    assert "is not asserted" in fails("retract", den, "object/1", "label")
    assert "exactly one here:x" in fails(
        "update", den, "-e", "INSERT DATA {<http://m/object/1> here:x 4}"
    )
    assert "does not parse at line 1" in fails("update", den, "-e", "INSERT DATA {")
    assert "cannot read the update" in fails("update", den, "/nowhere/x.ru")


@pytest.mark.parametrize(
    "words",
    [["update", "MAP"], ["assert", "MAP", "object/1", "category", "cup"], ["retract", "MAP"]],
)
def test_wrong_usage_exits_2(den, words):
    with pytest.raises(SystemExit) as stopped:
        main([str(den) if word == "MAP" else word for word in words])
    assert stopped.value.code == 2
