"""`hereabouts name`."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.maps.object_pictures import ObjectPictures
from kg.model.records import Evidence, MapUpdate
from kg.serving.opening import create_map


@pytest.fixture
def den(tmp_path: Path) -> Path:
    """A map with two cups that have pictures."""
    path = tmp_path / "den.map"
    with create_map(path, base="http://m/") as semantic_map:
        semantic_map.update(
            "INSERT DATA { <object/1> a here:Cup ; here:x 1 ; here:y 2 ; here:existence 0.9 . "
            "<object/2> a here:Cup ; here:x 3 ; here:y 2 ; here:existence 0.9 }"
        )
        shown = Evidence("room", "frame-1", 0.0, (0.0, 0.0, 9.0, 9.0), 0.9, "network")
        records = [replace(one, evidence=shown) for one in semantic_map.perceived.objects()]
        semantic_map.apply(MapUpdate(tuple(records)))
        for record in records:
            ObjectPictures(path).write(record, b"\xff\xd8 a picture")
    return path


def categories(prints, den: Path) -> list[str]:
    rows = json.loads(prints("ask", den, "objects", "--format", "json"))
    return [row["category"] for row in sorted(rows, key=lambda row: row["object"])]


def test_a_thing_has_its_name_until_it_is_retracted(den, prints, capsys):
    prints("name", den, "object/1", "coffee", "machine", "--by", "ann")
    assert categories(prints, den) == ["coffee machine", "cup"]
    assert main(["retract", str(den), "object/1", "category", "--by", "ann"]) == 0
    assert categories(prints, den) == ["cup", "cup"]


def test_a_page_shows_things_that_have_no_name_first(den, prints, tmp_path):
    prints("name", den, "object/1", "Tom & Co's mug", "--by", "ann")
    page = tmp_path / "sheet.html"
    prints("name", den, "--review", page)
    text = page.read_text(encoding="utf-8")
    assert text.index('name="object/2"') < text.index('name="object/1"')
    assert "Tom &amp; Co&#x27;s mug, named by ann" in text
    assert text.count("<img") == 2 and "://" not in text


def test_names_of_a_file_are_given_and_the_refused_ones_listed(den, prints, tmp_path, capsys):
    names = tmp_path / "names.csv"
    names.write_text('object/1,"espresso, cup"\nobject/2,<b>\nobject/9,x\nobject/2,\n')
    assert main(["name", str(den), "--from", str(names), "--by", "ann", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert [(one["thing"], one["category"], one["by"]) for one in told["named"]] == [
        ("object/1", "espresso, cup", "ann")
    ]
    assert [one["thing"] for one in told["refused"]] == ["object/2", "object/9"]
    assert categories(prints, den) == ["espresso, cup", "cup"]


def test_the_name_that_another_gave_is_told(den, prints, capsys):
    prints("name", den, "object/1", "my mug", "--by", "ann")
    assert main(["name", str(den), "object/1", "tea mug", "--by", "bob"]) == 0
    assert "object/1: tea mug (named by bob, before: my mug by ann)" in capsys.readouterr().err


@pytest.mark.parametrize(
    "content", [None, b"", b"\xff\xfe\x00", b"object/1\n", b"object/1,a,b\n", b"object/1,\n"]
)
def test_a_file_without_names_is_refused_in_one_line(den, tmp_path, capsys, content):
    names = tmp_path / "names.csv"
    if content is not None:
        names.write_bytes(content)
    assert main(["name", str(den), "--from", str(names), "--by", "ann"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("thing", ["object/1 ; DROP", "object/9", "", "a:b c", "place/1", "<b>"])
def test_a_thing_that_does_not_exist_is_refused_in_one_line(den, capsys, thing):
    assert main(["name", str(den), thing, "mug", "--by", "ann"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_the_page_is_not_written_into_the_map(den, capsys):
    assert main(["name", str(den), "--review", str(den / "sheet.html")]) == 1
    assert not (den / "sheet.html").exists()
