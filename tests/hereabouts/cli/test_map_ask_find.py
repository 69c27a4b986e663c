"""A recording becomes a map that answers: the whole path, through the command line."""

import csv
import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pyoxigraph
import pytest
from pyoxigraph import RdfFormat

from hereabouts.cli import main

Prints = Callable[..., str]
CHAIR = "https://w3id.org/hereabouts#Chair"
WAYS = ("kitchen", "1", "place/1")  # to say the only place of a map
FORMATS = {
    "ttl": RdfFormat.TURTLE,
    "trig": RdfFormat.TRIG,
    "nq": RdfFormat.N_QUADS,
    "jsonld": RdfFormat.JSON_LD,
    "rdf": RdfFormat.RDF_XML,
}


@pytest.fixture
def mapped(kitchen_map: Path) -> Path:
    """To be read alone."""
    return kitchen_map


def test_a_kitchen_is_mapped_asked_searched_checked(mapped: Path, prints: Prints) -> None:
    summary = json.loads(prints("ask", mapped, "summary", "--format", "json"))
    assert {"chair", "cup"} <= {row["category"] for row in summary}

    (place,) = json.loads(prints("ask", mapped, "places", "--format", "json"))
    assert place["category"] == "kitchen"

    plan = json.loads(prints("find", mapped, "cup", "--json"))
    assert plan["target"] == "cup"
    assert {goal["kind"] for goal in plan["goals"]} == {"known", "place"}
    assert all(0 < goal["probability"] <= 1 and goal["why"] for goal in plan["goals"])
    assert plan["expected_seconds"] > 0

    unseen = json.loads(prints("find", mapped, "banana", "--json"))
    assert [goal["kind"] for goal in unseen["goals"]] == ["place"]
    assert "kitchen" in unseen["goals"][0]["why"]

    assert prints("check", mapped) == ""


def test_mapping_without_a_terminal_tells_how_far_it_is(kitchen, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hereabouts.cli.map_recording._TELL_EVERY", 0.0)
    assert main(["map", str(kitchen), "--into", str(tmp_path / "k.map"), "--limit", "2"]) == 0
    told = capsys.readouterr().err
    assert "1 of 2 frames, " in told and "2 of 2 frames, " in told


def test_mapping_again_does_nothing_until_asked(kitchen_map, kitchen, prints, tmp_path):
    mapped = shutil.copytree(kitchen_map, tmp_path / "kitchen.map")
    before = prints("ask", mapped, "objects", "--format", "csv")
    words = ("map", kitchen, "--no-check", "--into", mapped, "--json")
    report = json.loads(prints(*words))
    assert (report["frames"], report["skipped"]) == (0, 8)
    assert prints("ask", mapped, "objects", "--format", "csv") == before

    again = json.loads(prints(*words, "--again", "--limit", 3))
    assert (again["frames"], again["skipped"]) == (3, 0)


def test_pictures_show_each_frame(kitchen: Path, prints: Prints, tmp_path: Path) -> None:
    words = ("--pictures", tmp_path / "pictures", "--limit", 2, "--no-floor")
    prints("map", kitchen, "--no-check", "--into", tmp_path / "k.map", *words)
    pictures = sorted((tmp_path / "pictures").iterdir())
    assert [path.name for path in pictures] == ["frame-000000.jpg", "frame-000032.jpg"]
    assert all(path.read_bytes().startswith(b"\xff\xd8") for path in pictures)


def test_answers_come_in_every_format(lab: Path, prints: Prints) -> None:
    rows = json.loads(prints("ask", lab, "objects", "--all", "--format", "json"))
    assert len(rows) == 91
    table = list(csv.reader(io.StringIO(prints("ask", lab, "objects", "--all", "--format", "csv"))))
    assert len(table) == 92
    assert "chair" in prints("ask", lab, "objects")
    turtle = prints(
        "ask", lab, "-e", "CONSTRUCT WHERE { ?chair a here:Chair ; here:x ?x }", "--format", "ttl"
    )
    triples = list(pyoxigraph.parse(turtle, format=RdfFormat.TURTLE))
    assert len(triples) == 2 * sum(row["category"] == "chair" for row in rows)


def test_a_table_has_details_only_where_they_are_asked_for(lab, prints, capsys):
    whole, brief = prints("ask", lab, "objects", "--explain"), prints("ask", lab, "objects")
    assert "observations" in whole and "observations" not in brief and "existence" in brief
    rows = json.loads(prints("ask", lab, "objects", "--format", "json"))
    assert rows[0]["observations"] >= 1
    text = "SELECT (COUNT(?o) AS ?observations) { ?o here:x ?x }"
    assert "observations" in prints("ask", lab, text)
    capsys.readouterr()
    assert main(["ask", str(lab), "where is the chair?"]) == 0
    assert "objects-by-category" not in capsys.readouterr().err
    assert "xmax" not in prints("ask", lab, "which rooms are there?")
    assert "xmax" in prints("ask", lab, "which rooms are there?", "--explain")
    assert main(["ask", str(lab), "where is the chair?", "--explain"]) == 0
    assert f"hereabouts ask {lab} objects-by-category" in capsys.readouterr().err


def test_sparql_text_is_asked_without_an_option(lab: Path, prints: Prints) -> None:
    text = "SELECT ?o { ?o here:x ?x FILTER(?x > $least) }"
    option = prints("ask", lab, "--format", "csv", "-e", text, "-p", "least=0")
    assert option == prints("ask", lab, text, "--format", "csv", "-p", "least=0")
    assert len(option.splitlines()) > 1


def test_a_query_file_of_ones_own_is_asked(lab: Path, prints: Prints, tmp_path: Path) -> None:
    question = tmp_path / "high-things.rq"
    question.write_text(
        "#+ summary: Objects above a height\n"
        "#+ parameters:\n#+   height (double): metres\n"
        "#+ columns: object, z\n"
        "SELECT ?object ?z WHERE { ?object here:confidence ?c ; here:z ?z FILTER(?z > $height) }\n"
        "ORDER BY DESC(?z) ?object\n"
    )
    rows = json.loads(prints("ask", lab, question, "-p", "height=1.0", "--format", "json"))
    assert rows
    assert all(row["z"] > 1.0 for row in rows)


@pytest.mark.parametrize("ending", FORMATS)
def test_the_map_leaves_as_linked_data(lab, prints, tmp_path, ending):
    file = tmp_path / f"lab.{ending}"
    prints("export", lab, "-o", file)
    quads = list(pyoxigraph.parse(path=str(file), format=FORMATS[ending]))
    chairs = {q.subject for q in quads if q.object == pyoxigraph.NamedNode(CHAIR)}
    assert len(chairs) > 10
    assert any("POINT Z" in str(q.object) for q in quads)


def test_the_authors_maps_survive_save_and_reload(lab, prints, tmp_path):
    prints("thesis", "export", lab, "-o", tmp_path / "saved")
    prints(
        *("thesis", "import", "--into", tmp_path / "again.map"),
        *("--objects", tmp_path / "saved" / "saved_objects.json"),
        *("--places", tmp_path / "saved" / "saved_places.json"),
    )
    question = ("objects-in-box", "-p", "xmin=-99", "-p", "xmax=99", "-p", "ymin=-99")
    cells = [
        [
            {name: row[name] for name in ("category", "x", "y", "z", "confidence")}
            for row in json.loads(
                prints("ask", path, *question, "-p", "ymax=99", "--all", "--format", "json")
            )
        ]
        for path in (lab, tmp_path / "again.map")
    ]
    assert len(cells[0]) == 91
    assert sorted(map(str, cells[0])) == sorted(map(str, cells[1]))


def test_all_lists_what_probably_is_not_there_too(lab: Path, prints: Prints) -> None:
    def rows(*words: str) -> list[dict[str, object]]:
        return list(json.loads(prints("ask", lab, *words, "--format", "json")))

    some, everything = rows("objects"), rows("objects", "--all")
    assert len(some) < len(everything) == 91
    assert [row for row in everything if row["existence"] >= 0.5] == some
    assert rows("objects", "--all", "-p", "least=0.5") == some, "what is given counts"
    assert rows("places", "--all") == rows("places"), "places have no existence"
    assert sum(row["count"] for row in rows("summary", "--all")) == 91


def test_a_plan_is_drawn_with_its_looks_in_words(mapped, prints, tmp_path):
    drawn = tmp_path / "find.svg"
    prints("find", mapped, "banana", "--from", "0,0,90", "--now", "map", "--picture", drawn)
    assert re.search(r"finds it with [\d.]+ % after \d+ s", drawn.read_text())


def test_food_is_searched_without_being_prompted(mapped: Path, prints: Prints) -> None:
    plan = json.loads(prints("find", mapped, "food", "--from", "0,0", "--json"))
    assert plan["target"] == "food"
    assert any("banana" in goal["why"] for goal in plan["goals"])
    assert plan["expected_seconds"] > 0


def test_every_command_has_help_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    from hereabouts.cli import main

    for words in (["ask"], ["map"], ["find"], ["plot"], ["export"], ["check"], ["evaluate", "map"]):
        with pytest.raises(SystemExit) as stopped:
            main([*words, "--help"])
        assert stopped.value.code == 0
        assert "example: hereabouts" in capsys.readouterr().out


def test_wrong_usage_is_one_line_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    from hereabouts.cli import main

    for words in (["ask", "x.map"], ["find", "x.map"], ["find", "x.map", "cup", "--from", "a,b"]):
        with pytest.raises(SystemExit) as stopped:
            main(words)
        assert stopped.value.code == 2
        told = capsys.readouterr().err
        assert told.startswith("error: ")
        assert told.count("\n") == 1
        assert f"example: hereabouts {words[0]}" in told


def test_negative_coordinates_and_axes_need_no_equals_sign(kitchen, mapped, prints, tmp_path):
    asked = ("find", mapped, "chair", "--now", "map")
    assert prints(*asked, "--from", "-1,-2.5") == prints(*asked, "--from=-1,-2.5")
    prints("map", kitchen, "--into", tmp_path / "k.map", "--limit", 1, "--no-floor", "--up", "-y")


def test_things_are_asked_about_as_tables_print_them(mapped: Path, prints: Prints) -> None:
    (first, *_) = csv.DictReader(io.StringIO(prints("ask", mapped, "objects", "--format", "csv")))
    short = "/".join(first["object"].split("/")[-2:])
    assert first["label"] in prints("ask", mapped, "why-object", "-p", f"object={short}")
    answers = {prints("ask", mapped, "objects-in-place", "-p", f"place={p}") for p in WAYS}
    assert len(answers) == 1


def test_numbers_given_to_free_sparql_are_numbers(lab: Path, prints: Prints) -> None:
    ask = ["ask", lab, "--format", "csv", "-e", "SELECT ?o { ?o here:x ?x FILTER(?x > $least) }"]
    east = len(prints(*ask, "-p", "least=10.5").splitlines())
    assert 1 < east < len(prints(*ask, "-p", "least=-1e3").splitlines())
