"""What assertions come to: synonyms together, negations against, senses apart, kinds weaker."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.knowledge.conceptnet.edges import probability_of, votes_of, weight_of
from kg.knowledge.conceptnet.importing import ConceptNetImport, import_conceptnet
from kg.knowledge.conceptnet.relate import ImportedRelation
from kg.model import vocabulary as v

Shared = Callable[[str], Path]
Line = tuple[str, str, str, int]  # start, relation, end, score; a score below 0 is negated


def graph4(path: Path, *lines: Line) -> Path:
    """A graph of ConceptNet 4 with these assertions."""
    path.write_text(
        "".join(
            f"{start}\t{end}\t{{'freq': {5 if score > 0 else -5}, 'score': {abs(score)}, "
            f"'rel': u'{relation}'}}\n"
            for start, relation, end, score in lines
        )
    )
    return path


def tsv5(path: Path, *lines: tuple[str, str, str, float]) -> Path:
    """A TSV of ConceptNet 5 with these assertions: (start, relation, end, weight)."""
    path.write_text(
        "".join(
            f"/a/[/r/{relation}/,/c/en/{start}/,/c/en/{end}/]\t/r/{relation}\t/c/en/{start}\t"
            f"/c/en/{end}\t{json.dumps({'weight': weight, 'license': 'cc:by/4.0'})}\n"
            for start, relation, end, weight in lines
        )
    )
    return path


def one(
    imported: ConceptNetImport, subject: str, target: str, kind: str = v.LOCATED_AT
) -> ImportedRelation | None:
    """The relation between two categories, by the names of their classes."""
    wanted = (kind, v.HERE + subject, v.HERE + target)
    found = [f for f in imported.found if (f.kind, f.subject, f.target) == wanted]
    assert len(found) <= 1
    return found[0] if found else None


def test_synonyms_and_spellings_add_their_votes(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        ("tv", "AtLocation", "live room", 4),
        ("television", "AtLocation", "livingroom", 1),
        ("tv set", "AtLocation", "work out", 9),
        ("tv", "AtLocation", "live room", 2),  # a duplicate is other people's votes
    )
    found = one(import_conceptnet(path), "Tv", "LivingRoom")
    assert found is not None
    assert found.weight == pytest.approx(weight_of(7), abs=1e-3)
    assert found.probability == pytest.approx(probability_of(found.weight), abs=1e-3)
    assert found.surfaces == ("tv AtLocation live room", "television AtLocation livingroom")
    assert found.sources[0].startswith("https://conceptnet.io/a/")


def test_the_same_assertion_of_conceptnet_5_twice_is_one(tmp_path: Path) -> None:
    once = ("cup", "AtLocation", "kitchen", 2.0)
    found = one(import_conceptnet(tsv5(tmp_path / "t", once, once)), "Cup", "Kitchen")
    assert found is not None
    assert found.weight == 2.0


def test_negated_assertions_speak_against_and_may_win(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        ("cup", "AtLocation", "kitchen", 6),
        ("cup", "AtLocation", "kitchen", -2),
        ("cup", "AtLocation", "attic", 2),
        ("cup", "AtLocation", "attic", -2),
    )
    imported = import_conceptnet(path)
    found = one(imported, "Cup", "Kitchen")
    assert found is not None
    assert (found.weight, found.weight_against) == (round(weight_of(6), 3), 2.0)
    assert found.probability == pytest.approx(probability_of(weight_of(6) - 2), abs=1e-3)
    assert one(imported, "Cup", "Attic") is None
    assert imported.weak == 1


def test_a_negated_relation_of_conceptnet_5_speaks_against(tmp_path: Path) -> None:
    lines = [("cup", "AtLocation", "kitchen", 4.0), ("cup", "NotAtLocation", "kitchen", 1.0)]
    found = one(import_conceptnet(tsv5(tmp_path / "t", *lines)), "Cup", "Kitchen")
    assert found is not None
    assert found.weight_against == 1.0


def test_located_near_is_symmetric_and_at_location_is_not(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g", ("fork", "LocatedNear", "knife", 2), ("cup", "AtLocation", "sink", 4)
    )
    imported = import_conceptnet(path)
    assert one(imported, "Fork", "Knife", v.NEAR_BY)
    assert one(imported, "Knife", "Fork", v.NEAR_BY)
    assert one(imported, "Cup", "Sink", v.NEAR_BY)
    assert one(imported, "Sink", "Cup", v.NEAR_BY) is None


def test_a_place_that_has_a_thing_counts_half_as_much(tmp_path: Path) -> None:
    found = one(
        import_conceptnet(graph4(tmp_path / "g", ("kitchen", "HasA", "stove", 8))),
        *("Oven", "Kitchen"),
    )
    assert found is not None
    assert found.weight == pytest.approx(weight_of(4), abs=1e-3)


ANIMALS = [
    *(("mouse", "IsA", "mammal", 6), ("rodent", "IsA", "animal", 9)),
    *(("mouse", "IsA", "rodent", 3), ("mammal", "IsA", "animal", 9)),
    *(("bat", "IsA", "animal", 5), ("bat", "AtLocation", "attic", 9)),
    *(("laptop", "AtLocation", "office", 9), ("keyboard", "AtLocation", "office", 5)),
    *(("mouse", "AtLocation", "attic", 8), ("mouse", "AtLocation", "office", 8)),
]


def test_the_animal_in_the_attic_is_not_the_mouse_on_the_desk(tmp_path: Path) -> None:
    imported = import_conceptnet(graph4(tmp_path / "g", *ANIMALS))
    assert one(imported, "Mouse", "Attic") is None
    assert one(imported, "Mouse", "Office")
    innocent = [line for line in ANIMALS if line[1] != "IsA"]
    imported = import_conceptnet(graph4(tmp_path / "g", *innocent))
    assert one(imported, "Mouse", "Attic"), "nothing says that a mouse may be an animal"


def test_a_mouse_is_where_computers_are(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(line for line in ANIMALS if line[2] != "office"),
        *(("stove", "IsA", "appliance", 5), ("stove", "AtLocation", "kitchen", 9)),
        *(("mouse", "AtLocation", "kitchen", 6), ("mouse", "AtLocation", "fridge", 6)),
        *(("mouse", "PartOf", "computer", 9), ("computer", "AtLocation", "office", 9)),
    )
    imported = import_conceptnet(path)
    assert one(imported, "Mouse", "Kitchen") is None
    assert one(imported, "Mouse", "Refrigerator", v.NEAR_BY) is None
    found = one(imported, "Mouse", "Office")
    assert found is not None
    assert found.weight == pytest.approx(weight_of(0.5 * 4.5), abs=1e-3)


def test_what_is_in_rooms_and_in_a_hotel_is_inside_it(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(("bed", "AtLocation", "hotel", 3), ("bed", "AtLocation", "hotel room", 2)),
        *(("bed", "AtLocation", "bedroom", 9), ("bed", "AtLocation", "church", 3)),
        *(("bench", "AtLocation", "church", 3), ("bench", "AtLocation", "hotel", 3)),
    )
    imported = import_conceptnet(path)
    found = one(imported, "Bed", "HotelRoom")
    assert found is not None
    assert found.weight == pytest.approx(weight_of(5), abs=1e-3)
    assert len(found.sources) == 2
    assert one(imported, "Bed", "HotelOutdoor") is None
    assert one(imported, "Bed", "ChurchOutdoor") is None, "no category is the inside of a church"
    assert one(imported, "Bench", "HotelOutdoor"), "nothing says that benches are in rooms"
    assert one(imported, "Bench", "ChurchOutdoor")


def test_a_wider_word_counts_half_and_where_the_own_name_is_used(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(("dining table", "AtLocation", "restaurant", 2), ("table", "AtLocation", "bar", 4)),
        *(("table", "AtLocation", "dining room", 4), ("table", "AtLocation", "office", 9)),
        *(("ball", "AtLocation", "ballroom", 1), ("ball", "AtLocation", "playground", 2)),
    )
    found = {(f.subject, f.target): f.weight for f in import_conceptnet(path).found}
    assert found == {
        (v.HERE + "DiningTable", v.HERE + "Restaurant"): 2.0,
        (v.HERE + "DiningTable", v.HERE + "Bar"): 2.0,  # an eating place too
        (v.HERE + "DiningTable", v.HERE + "DiningRoom"): round(weight_of(4), 3),
        (v.HERE + "SportsBall", v.HERE + "Playground"): 1.0,
    }


def test_what_is_alike_is_not_near_and_what_shares_a_place_is(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(("horse", "LocatedNear", "zebra", 5), ("horse", "AtLocation", "pasture", 3)),
        *(("cow", "AtLocation", "pasture", 3), ("cow", "LocatedNear", "horse", 1)),
        *(("fork", "AtLocation", "kitchen", 3), ("fork", "AtLocation", "airplane", 2)),
        *(("book", "LocatedNear", "lamp", 1), ("book", "LocatedNear", "clock", 2)),
    )
    found = import_conceptnet(path).found
    near = {(f.subject, f.target) for f in found if f.kind == v.NEAR_BY}
    pairs = {("Cow", "Horse"), ("Horse", "Cow"), ("Book", "Clock"), ("Clock", "Book")}
    assert near == {(v.HERE + one, v.HERE + other) for one, other in pairs}


def test_an_animal_in_a_shop_or_a_restaurant_is_meat(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(("cow", "AtLocation", "butcher shop", 5), ("cow", "AtLocation", "pasture", 3)),
        *(("sheep", "AtLocation", "restaurant", 4), ("cat", "AtLocation", "kitchen", 1)),
        ("person", "AtLocation", "butcher shop", 2),
    )
    found = {(f.subject, f.target) for f in import_conceptnet(path).found}
    wanted = {("Cow", "Pasture"), ("Cat", "Kitchen"), ("Person", "ButchersShop")}
    assert found == {(v.HERE + one, v.HERE + other) for one, other in wanted}


def test_one_vote_brings_no_car_into_a_museum(tmp_path: Path) -> None:
    lines: list[Line] = [("car", "AtLocation", "highway", 12)]
    lines += [("car", "AtLocation", "museum", 1), ("cat", "AtLocation", "yard", 5)]
    lines += [("cat", "AtLocation", "bedroom", 1), ("cat", "AtLocation", "kitchen", 1)]
    imported = import_conceptnet(graph4(tmp_path / "g", *lines))
    assert one(imported, "Car", "MuseumIndoor") is None
    assert one(imported, "Cat", "Bedroom"), "of seven votes for cats two are indoors"
    lines.append(("car", "AtLocation", "museum", 1))
    assert one(import_conceptnet(graph4(tmp_path / "g", *lines)), "Car", "MuseumIndoor")


def test_a_kind_that_is_rather_one_of_other_things_is_not_inherited(tmp_path: Path) -> None:
    lines: list[Line] = [("bottle", "IsA", "vessel", 3), ("vessel", "AtLocation", "ocean", 9)]
    assert one(import_conceptnet(graph4(tmp_path / "g", *lines)), "Bottle", "Ocean")
    lines.append(("boat", "IsA", "vessel", 4))
    assert one(import_conceptnet(graph4(tmp_path / "g", *lines)), "Bottle", "Ocean") is None


def test_a_category_without_a_place_has_those_of_what_it_is_on_or_a_kind_of(
    tmp_path: Path,
) -> None:
    lines = [
        *(("vase", "AtLocation", "shelf", 4), ("shelf", "AtLocation", "closet", 6)),
        *(("shelf", "AtLocation", "pantry", 2), ("shelf", "AtLocation", "attic", 1)),
        *(("vase", "AtLocation", "windowsill", 1), ("windowsill", "AtLocation", "bedroom", 9)),
        *(("truck", "IsA", "car", 4), ("car", "AtLocation", "parking lot", 8)),
        *(("truck", "IsA", "shelf", 4), ("ball", "AtLocation", "bear", 8)),
    ]
    imported = import_conceptnet(graph4(tmp_path / "g", *lines))
    found = {(f.subject, f.target): f.weight for f in imported.found}
    assert found == {
        (v.HERE + "Vase", v.HERE + "Closet"): weight_of(0.5 * 4 * 6 / 8),
        (v.HERE + "Vase", v.HERE + "Pantry"): weight_of(0.5 * 4 * 2 / 8),
        (v.HERE + "Truck", v.HERE + "ParkingLot"): 2.0,
        (v.HERE + "Car", v.HERE + "ParkingLot"): round(weight_of(8), 3),
    }
    known = graph4(tmp_path / "g", *lines, ("vase", "AtLocation", "kitchen", 1))
    places = [f.target for f in import_conceptnet(known).found if f.subject == v.HERE + "Vase"]
    assert places == [v.HERE + "Kitchen"], "what is said of the vase itself is enough"


def test_what_is_said_of_another_group_is_not_inherited(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(("boat", "IsA", "water", 17), ("boat", "IsA", "ship", 4), ("ship", "IsA", "vehicle", 3)),
        *(("water", "AtLocation", "dam", 9), ("ship", "AtLocation", "harbor", 9)),
    )
    imported = import_conceptnet(path)
    assert one(imported, "Boat", "Dam") is None
    assert one(imported, "Boat", "Harbor")


def test_conceptnet_5_names_the_sense(tmp_path: Path) -> None:
    path = tsv5(
        tmp_path / "t",
        ("mouse/n/wn/animal", "AtLocation", "attic", 4.0),
        ("mouse/n/wn/artifact", "AtLocation", "office", 4.0),
        ("banana/n/wn/plant", "AtLocation", "garden", 4.0),
        ("banana/n/wn/food", "AtLocation", "kitchen", 4.0),
        ("fork/v", "AtLocation", "kitchen", 4.0),
    )
    imported = import_conceptnet(path)
    assert one(imported, "Mouse", "Attic") is None
    assert one(imported, "Mouse", "Office")
    assert one(imported, "Banana", "Kitchen")
    assert one(imported, "Fork", "Kitchen") is None


def test_what_is_said_of_fruit_counts_a_quarter_for_a_banana(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        *(("banana", "IsA", "fruit", 5), ("fruit", "IsA", "food", 2)),
        ("fruit", "AtLocation", "pantry", 8),
        ("food", "AtLocation", "kitchen", 8),  # the ontology says that a banana is food
        ("apple", "IsA", "fruit", 1),  # one vote passes nothing on
    )
    imported = import_conceptnet(path)
    for place in ("Pantry", "Kitchen"):
        found = one(imported, "Banana", place)
        assert found is not None
        assert found.weight == pytest.approx(weight_of(2), abs=1e-3)
    assert one(imported, "Apple", "Pantry") is None


def test_a_doubtful_name_counts_half_and_a_synonym_becomes_one(tmp_path: Path) -> None:
    path = tsv5(
        tmp_path / "t",
        ("notebook", "AtLocation", "office", weight_of(8)),
        ("settle", "Synonym", "couch", 2.0),
        ("settle", "AtLocation", "lobby", weight_of(8)),
        ("fork", "Synonym", "knife", 2.0),  # names another category: no synonym of ours
        ("fork", "AtLocation", "pantry", weight_of(8)),
    )
    imported = import_conceptnet(path)
    for subject, target in (("Laptop", "Office"), ("Couch", "Lobby")):
        found = one(imported, subject, target)
        assert found is not None
        assert found.weight == pytest.approx(weight_of(4), abs=1e-2)
    assert one(imported, "Knife", "Pantry") is None


def test_a_subclass_needs_agreement_and_one_group(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        ("banana", "IsA", "food", 4),
        ("mouse", "IsA", "animal", 9),  # the ontology has it under electronics
        ("person", "IsA", "animal", 5),
        ("person", "IsA", "animal", -3),
        ("mountain", "IsA", "ocean", 9),  # places exclude each other
    )
    found = import_conceptnet(path).found
    subclasses = {(f.subject, f.target) for f in found if f.kind == v.RDFS_SUB_CLASS_OF}
    assert subclasses == {(v.HERE + "Banana", v.HERE + "Food")}
    assert all(f.probability is None for f in found)


def test_other_languages_are_not_ours(tmp_path: Path) -> None:
    path = tsv5(tmp_path / "t", ("cup", "AtLocation", "kitchen", 4.0))
    assert import_conceptnet(path, language="de").found == ()
    german = path.read_text().replace("/c/en/", "/c/de/")
    path.write_text(german)
    assert import_conceptnet(path).found == ()
    assert one(import_conceptnet(path, language="de"), "Cup", "Kitchen")


@settings(deadline=None)
@given(st.floats(0.01, 1e4), st.floats(0.01, 1e4))
def test_probability_rises_with_weight_and_weight_with_votes(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert 0 < probability_of(low) <= probability_of(high) <= 1
    assert weight_of(low) <= weight_of(high)
    assert votes_of(weight_of(low)) == pytest.approx(low)


def test_one_vote_is_weak_evidence_and_none_is_the_base_rate() -> None:
    assert probability_of(0) == probability_of(-3) == pytest.approx(0.025, abs=1e-3)
    assert probability_of(1) == pytest.approx(0.1, abs=5e-3)
    assert probability_of(math.e - 1, (-1, 1)) == 0.5


def test_the_real_graph_puts_things_where_they_belong(shared: Shared) -> None:
    imported = import_conceptnet(shared("data/conceptnet/conceptnet4_en.graph.gz"))
    assert imported.lines == 488_014
    assert not imported.skipped
    for subject, target in [
        *(("Bed", "Bedroom"), ("Tv", "LivingRoom"), ("Laptop", "Office"), ("Sink", "Kitchen")),
        *(("Toilet", "Shower"), ("Chair", "Office"), ("Banana", "Pantry"), ("Knife", "Kitchen")),
        *(("Mouse", "Office"), ("Vase", "DiningRoom"), ("TeddyBear", "Bedroom")),
    ]:
        assert one(imported, subject, target), (subject, target)
    for subject, target in [
        *(("Mouse", "Attic"), ("Mouse", "Kitchen"), ("Tv", "Kitchen"), ("Kite", "Attic")),
        *(("Boat", "Dam"), ("Bed", "HotelOutdoor"), ("Toilet", "ChurchOutdoor")),
        *(("DiningTable", "Office"), ("SportsBall", "Ballroom"), ("Cow", "ButchersShop")),
        *(("Bed", "Motel"), ("Tv", "OfficeBuilding"), ("Fork", "Airplane")),
    ]:
        assert one(imported, subject, target) is None, (subject, target)


def test_both_formats_of_the_same_data_agree(shared: Shared, tmp_path: Path) -> None:
    five = shared("data/conceptnet/conceptnet4_en_indoor.cn5.tsv.gz")
    with gzip.open(five, "rt", encoding="utf-8") as lines:
        rows = [line.rstrip("\n").split("\t") for line in lines]
    data = [(row, json.loads(row[4])) for row in rows]
    four = graph4(
        tmp_path / "g",
        *(
            (row[2][6:].replace("_", " "), row[1][3:], row[3][6:].replace("_", " "), known["score"])
            for row, known in data
            if "'" not in row[1]
        ),
    )
    with_5, with_4 = import_conceptnet(five), import_conceptnet(four)
    keys_5 = {(f.kind, f.subject, f.target): f.weight for f in with_5.found}
    keys_4 = {(f.kind, f.subject, f.target): f.weight for f in with_4.found}
    assert keys_5.keys() == keys_4.keys()
    assert all(keys_5[key] == pytest.approx(keys_4[key], rel=0.01) for key in keys_5)
