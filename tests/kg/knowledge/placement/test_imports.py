"""Tables of rooms: read, mapped to our categories, and refused in one line where they are wrong."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hereabouts.cli import main
from kg.knowledge.ontology.lint import check_ontologies
from kg.knowledge.ontology.loading import load_ontologies
from kg.knowledge.placement.statistics import read_rooms, statistics, write_rooms
from kg.knowledge.placement.surveys import room_types
from kg.model.errors import HereaboutsError, InvalidFactError
from kg.model.resources import ONTOLOGIES
from kg.model.vocabulary import PREFIXES
from tests.shipped_ontology import CATALOGUE

Shared = Callable[[str], Path]
HEAD = "room,n_rooms,object,rooms_with_object\n"


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "rooms.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def labels(name: str) -> list[str]:
    return [kind.label for kind in room_types(name, CATALOGUE)]


def test_room_names_become_our_categories() -> None:
    assert labels("bathroom") == ["shower"]
    assert labels("hall/stairwell") == ["corridor"]
    assert labels("kitchen/living room") == ["kitchen", "living room"]
    assert labels("tie: bedroom & office") == ["bedroom", "home office"]
    assert labels("other") == []
    (toilet,) = room_types("Toilet", CATALOGUE)
    assert toilet.below == CATALOGUE.find("shower", "place").iri


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no column room"),
        ("room,n_rooms,object\nkitchen,3,oven\n", "no column rooms_with_object"),
        (HEAD + "kitchen,3,oven,4\n", "line 2: 4 of 3 rooms"),
        (HEAD + "kitchen,-3,oven,1\n", "line 2: n_rooms must be a whole number"),
        (HEAD + "kitchen,3.5,oven,1\n", "'3.5'"),
        (HEAD + "kitchen,٣,oven,1\n", "n_rooms must be"),
        (HEAD + "kitchen,0,oven,0\n", "at least 1"),
        (HEAD + "kitchen,3,oven,1\nkitchen,4,cup,1\n", "line 3: 'kitchen' has 4 rooms here, 3"),
        (HEAD + "kitchen,3,oven,1\nkitchen,3,oven,1\n", "line 3: 'oven' in 'kitchen' occurs twice"),
        (HEAD + "kitchen,3,oven\n", "more or fewer fields"),
        (HEAD + ",3,oven,1\n", "room is empty"),
        (HEAD + "kitchen,3,unicorn,1\n", "no room and object"),
        (HEAD + '"kitchen,3,oven,1\n', "no readable CSV"),
        (HEAD.encode() + b"k\xfftchen,3,oven,1\n", "no readable CSV in UTF-8"),
        (HEAD + "kitchen," + "9" * 400 + ",oven,1\n", "n_rooms must be"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, text, says, capsys):
    path, into = table(tmp_path, text), tmp_path / "out.ttl"
    with pytest.raises(InvalidFactError) as error:
        read_rooms(path, CATALOGUE, "s")
    assert says in str(error.value)
    assert main(["import", "rooms", str(path), "--into", str(into)]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert not into.exists()


def test_a_missing_table_and_a_wrong_licence_are_refused(tmp_path: Path) -> None:
    into = ["--into", str(tmp_path / "new.map")]
    assert main(["import", "rooms", str(tmp_path / "none.csv"), *into]) == 1
    path = table(tmp_path, HEAD + "kitchen,3,oven,1\n")
    assert main(["import", "rooms", str(path), *into, "--license", "a b>"]) == 1
    assert not (tmp_path / "new.map").exists()


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    max_examples=12,
)
@given(st.text(max_size=30), st.text(max_size=30), st.text(max_size=12))
def test_names_of_any_kind_never_break_the_file(tmp_path, room, source, number):
    quoted = room.replace('"', '""').encode("utf-8", "ignore").decode()
    path = table(tmp_path, f'{HEAD}kitchen,5,oven,2\n"{quoted}",4,"cup",{number or 1}\n')
    try:
        found = read_rooms(path, CATALOGUE, source or "s")
    except HereaboutsError as error:
        assert "\n" not in str(error).strip()
        return
    folder = tmp_path / "ontologies"
    folder.mkdir(exist_ok=True)
    (folder / "rooms.ttl").unlink(missing_ok=True)
    for _ in range(2):  # and the file is known again as its own
        write_rooms(found, folder / "rooms.ttl")
    assert statistics(load_ontologies(folder).quads) == tuple(sorted(found.statistics))


def test_more_rows_than_kinds_of_rooms_are_no_table_of_kinds_of_rooms(tmp_path: Path) -> None:
    rows = "".join(f"kitchen,1,thing {n},1\n" for n in range(200_001))
    with pytest.raises(InvalidFactError, match="more than 200,000 rows"):
        read_rooms(table(tmp_path, HEAD + rows), CATALOGUE, "s")


def test_the_file_is_the_same_each_time_and_a_well_made_ontology(tmp_path: Path) -> None:
    path = table(tmp_path, HEAD + "kitchen,5,oven,2\ngarage,7,bicycle,3\ncloset,2,oven,0\n")
    folder = tmp_path / "all"
    folder.mkdir()
    for shipped in ONTOLOGIES.glob("*.ttl"):
        (folder / shipped.name).write_bytes(shipped.read_bytes())
    written = set()
    for _ in range(2):
        arguments = ["import", "rooms", str(path), "--into", str(folder / "homes.ttl")]
        assert main([*arguments, "--license", "https://example.org/licence"]) == 0
        written.add((folder / "homes.ttl").read_bytes())
    assert len(written) == 1
    assert check_ontologies(folder) == []
    assert len(statistics(load_ontologies(folder).quads)) == 3


def test_statistics_of_real_homes_come_in(shared: Shared) -> None:
    path = shared("data/homes/hm3d_room_object_counts.csv")
    found = read_rooms(path, CATALOGUE, "HM3D")
    oven = CATALOGUE.find("oven").iri, CATALOGUE.find("kitchen").iri
    (one,) = [s for s in found.statistics if (s.object, s.place) == oven]
    assert (one.rooms, one.rooms_with) == (160, 127)
    assert found.unknown == ()
    assert {"garage", "toilet"} <= {kind.label for kind in found.new_types}


def test_a_table_saved_by_a_spreadsheet_is_read(tmp_path: Path) -> None:
    text = (HEAD + "kitchen,5,oven,2\n").replace("\n", "\r\n")
    path = table(tmp_path, b"\xef\xbb\xbf" + text.encode())
    (one,) = read_rooms(path, CATALOGUE, "s").statistics
    assert (one.rooms, one.rooms_with) == (5, 2)


@pytest.mark.parametrize(
    "held",
    [
        "here:Mug a owl:Class ; rdfs:subClassOf here:Cup .",
        "<https://w3id.org/hereabouts/statistics/b/Kitchen/Oven> a here:RoomStatistics ;"
        " here:statisticsObject here:Oven ; here:statisticsPlace here:Kitchen ;"
        ' here:roomCount 3 ; here:roomsWithObject 1 ; dct:source "b" .',
        '<https://w3id.org/hereabouts/room/garage> skos:altLabel "carport" .',
        "this is no Turtle",
    ],
)
def test_a_file_that_says_anything_else_is_not_overwritten(tmp_path, capsys, held):
    path = table(tmp_path, HEAD + "kitchen,5,oven,2\ngarage,7,bicycle,3\n")
    into = tmp_path / "mine.ttl"
    arguments = ["import", "rooms", str(path), "--into", str(into), "--source", "a"]
    assert main(arguments) == 0
    names = "".join(f"@prefix {name}: <{iri}> .\n" for name, iri in PREFIXES.items())
    text = names + into.read_text() + held + "\n"
    into.write_text(text)
    assert main(arguments) == 1
    assert "would overwrite" in capsys.readouterr().err
    assert into.read_text() == text


def test_an_ending_of_another_syntax_makes_no_map(tmp_path, capsys):
    path = table(tmp_path, HEAD + "kitchen,5,oven,2\n")
    assert main(["import", "rooms", str(path), "--into", str(tmp_path / "homes.owl")]) == 1
    assert "name a .ttl" in capsys.readouterr().err
    assert not (tmp_path / "homes.owl").exists()
