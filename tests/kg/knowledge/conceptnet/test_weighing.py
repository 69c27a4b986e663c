"""What assertions come to: synonyms together, negations against, senses apart, kinds weaker."""

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
Line = tuple[str, str, str, float]  # start, relation, end, votes (of ConceptNet 5: weight)

#: "Cup in Kitchen", "Fork near Knife", "Banana is Food" -> the kind of relation
KINDS = {"in": v.LOCATED_AT, "near": v.NEAR_BY, "is": v.RDFS_SUB_CLASS_OF}


def graph4(path: Path, *lines: Line) -> Path:
    """A graph of ConceptNet 4 with these assertions; votes below 0 are negated."""
    path.write_text(
        "".join(
            f"{start}\t{end}\t{{'freq': {5 if votes > 0 else -5}, 'score': {abs(votes)}, "
            f"'rel': u'{relation}'}}\n"
            for start, relation, end, votes in lines
        )
    )
    return path


def tsv5(path: Path, *lines: Line) -> Path:
    """A TSV of ConceptNet 5 with these assertions."""
    path.write_text(
        "".join(
            f"/a/[/r/{relation}/,/c/en/{start}/,/c/en/{end}/]\t/r/{relation}\t/c/en/{start}\t"
            f"/c/en/{end}\t{json.dumps({'weight': weight, 'license': 'cc:by/4.0'})}\n"
            for start, relation, end, weight in lines
        )
    )
    return path


def relations_of(imported: ConceptNetImport) -> dict[str, ImportedRelation]:
    names = {kind: word for word, kind in KINDS.items()}
    return {
        f"{f.subject.removeprefix(v.HERE)} {names[f.kind]} {f.target.removeprefix(v.HERE)}": f
        for f in imported.found
    }


ANIMALS: list[Line] = [
    *(("mouse", "IsA", "mammal", 6), ("rodent", "IsA", "animal", 9)),
    *(("mouse", "IsA", "rodent", 3), ("mammal", "IsA", "animal", 9)),
    *(("bat", "IsA", "animal", 5), ("bat", "AtLocation", "attic", 9)),
    *(("laptop", "AtLocation", "office", 9), ("keyboard", "AtLocation", "office", 5)),
    *(("mouse", "AtLocation", "attic", 8), ("mouse", "AtLocation", "office", 8)),
]
HOTELS: list[Line] = [
    *(("bed", "AtLocation", "hotel", 3), ("bed", "AtLocation", "hotel room", 2)),
    *(("bed", "AtLocation", "bedroom", 9), ("bed", "AtLocation", "church", 3)),
    *(("bench", "AtLocation", "church", 3), ("bench", "AtLocation", "hotel", 3)),
]
CARS: list[Line] = [
    *(("car", "AtLocation", "highway", 12), ("car", "AtLocation", "museum", 1)),
    *(("cat", "AtLocation", "yard", 5), ("cat", "AtLocation", "bedroom", 1)),
    ("cat", "AtLocation", "kitchen", 1),
]
VESSELS: list[Line] = [("bottle", "IsA", "vessel", 3), ("vessel", "AtLocation", "ocean", 9)]
VASES: list[Line] = [
    *(("vase", "AtLocation", "shelf", 4), ("shelf", "AtLocation", "closet", 6)),
    *(("shelf", "AtLocation", "pantry", 2), ("shelf", "AtLocation", "attic", 1)),
    *(("vase", "AtLocation", "windowsill", 1), ("windowsill", "AtLocation", "bedroom", 9)),
    *(("truck", "IsA", "car", 4), ("car", "AtLocation", "parking lot", 8)),
    *(("truck", "IsA", "shelf", 4), ("ball", "AtLocation", "bear", 8)),
]
#: assertions of ConceptNet 4, and relation -> its votes (True: some; None: it is not there);
#: "only" stands where there are no other relations
CASES4: dict[str, tuple[list[Line], dict[str, float | None]]] = {
    "negated assertions speak against and may win": (
        [
            *(("cup", "AtLocation", "kitchen", 6), ("cup", "AtLocation", "kitchen", -2)),
            *(("cup", "AtLocation", "attic", 2), ("cup", "AtLocation", "attic", -2)),
        ],
        {"Cup in Kitchen": 6, "only": 1},
    ),
    "near is symmetric and at is not": (
        [("fork", "LocatedNear", "knife", 2), ("cup", "AtLocation", "sink", 4)],
        {"Fork near Knife": 2, "Knife near Fork": 2, "Cup near Sink": 2, "only": 1},
    ),
    "a place that has a thing counts half": (
        [("kitchen", "HasA", "stove", 8)],
        {"Oven in Kitchen": 4},
    ),
    "the animal in the attic is not the mouse on the desk": (
        ANIMALS,
        {"Mouse in Attic": None, "Mouse in Office": True},
    ),
    "nothing says that a mouse may be an animal": (
        [line for line in ANIMALS if line[1] != "IsA"],
        {"Mouse in Attic": True},
    ),
    "a mouse is where computers are": (
        [
            *(line for line in ANIMALS if line[2] != "office"),
            *(("stove", "IsA", "appliance", 5), ("stove", "AtLocation", "kitchen", 9)),
            *(("mouse", "AtLocation", "kitchen", 6), ("mouse", "AtLocation", "fridge", 6)),
            *(("mouse", "PartOf", "computer", 9), ("computer", "AtLocation", "office", 9)),
        ],
        {"Mouse in Kitchen": None, "Mouse near Refrigerator": None, "Mouse in Office": 2.25},
    ),
    "what is in rooms and in a hotel is inside it": (
        HOTELS,
        {
            "Bed in HotelRoom": 5,
            "Bed in HotelOutdoor": None,
            "Bed in ChurchOutdoor": None,  # no category is the inside of a church
            "Bench in HotelOutdoor": True,  # nothing says that benches are in rooms
            "Bench in ChurchOutdoor": True,
        },
    ),
    "a wider word counts half where the own name is used": (
        [
            *(("dining table", "AtLocation", "restaurant", 2), ("table", "AtLocation", "bar", 4)),
            *(("table", "AtLocation", "dining room", 4), ("table", "AtLocation", "office", 9)),
            *(("ball", "AtLocation", "ballroom", 1), ("ball", "AtLocation", "playground", 2)),
        ],
        {
            "DiningTable in Restaurant": 2,
            "DiningTable in Bar": 2,  # an eating place too
            "DiningTable in DiningRoom": 4,
            "SportsBall in Playground": 1,
            "only": 1,
        },
    ),
    "what is alike is not near and what shares a place is": (
        [
            *(("horse", "LocatedNear", "zebra", 5), ("horse", "AtLocation", "pasture", 3)),
            *(("cow", "AtLocation", "pasture", 3), ("cow", "LocatedNear", "horse", 1)),
            *(("book", "LocatedNear", "lamp", 1), ("book", "LocatedNear", "clock", 2)),
        ],
        {
            **dict.fromkeys(("Cow near Horse", "Horse near Cow", "Book near Clock"), True),
            **dict.fromkeys(("Clock near Book", "Horse in Pasture", "Cow in Pasture"), True),
            "Horse near Zebra": None,
        },
    ),
    "an animal in a shop or a restaurant is meat": (
        [
            *(("cow", "AtLocation", "butcher shop", 5), ("cow", "AtLocation", "pasture", 3)),
            *(("sheep", "AtLocation", "restaurant", 4), ("cat", "AtLocation", "kitchen", 1)),
            ("person", "AtLocation", "butcher shop", 2),
        ],
        {"Cow in Pasture": 3, "Cat in Kitchen": 1, "Person in ButchersShop": 2, "only": 1},
    ),
    "one vote brings no car into a museum": (
        CARS,
        {"Car in MuseumIndoor": None, "Cat in Bedroom": True},  # of seven votes two are indoors
    ),
    "two votes bring a car into a museum": (
        [*CARS, ("car", "AtLocation", "museum", 1)],
        {"Car in MuseumIndoor": 2},
    ),
    "a kind is inherited": (VESSELS, {"Bottle in Ocean": True}),
    "a kind that is rather one of other things is not": (
        [*VESSELS, ("boat", "IsA", "vessel", 4)],
        {"Bottle in Ocean": None},
    ),
    "without a place of its own a thing has those of what it is on or a kind of": (
        VASES,
        {
            "Vase in Closet": 0.5 * 4 * 6 / 8,
            "Vase in Pantry": 0.5 * 4 * 2 / 8,
            "Truck in ParkingLot": 2,
            "Car in ParkingLot": 8,
            "only": 1,
        },
    ),
    "what is said of the vase itself is enough": (
        [*VASES, ("vase", "AtLocation", "kitchen", 1)],
        {"Vase in Kitchen": 1, "Vase in Closet": None, "Vase in Pantry": None},
    ),
    "what is said of another group is not inherited": (
        [
            *(("boat", "IsA", "water", 17), ("boat", "IsA", "ship", 4)),
            *(("ship", "IsA", "vehicle", 3), ("water", "AtLocation", "dam", 9)),
            ("ship", "AtLocation", "harbor", 9),
        ],
        {"Boat in Dam": None, "Boat in Harbor": True},
    ),
    "what is said of fruit counts a quarter for a banana": (
        [
            *(("banana", "IsA", "fruit", 5), ("fruit", "IsA", "food", 2)),
            ("fruit", "AtLocation", "pantry", 8),
            ("food", "AtLocation", "kitchen", 8),  # the ontology says that a banana is food
            ("apple", "IsA", "fruit", 1),  # one vote passes nothing on
        ],
        {"Banana in Pantry": 2, "Banana in Kitchen": 2, "Apple in Pantry": None},
    ),
    "a subclass needs agreement and one group": (
        [
            ("banana", "IsA", "food", 4),
            ("mouse", "IsA", "animal", 9),  # the ontology has it under electronics
            *(("person", "IsA", "animal", 5), ("person", "IsA", "animal", -3)),
            ("mountain", "IsA", "ocean", 9),  # places exclude each other
        ],
        {"Banana is Food": 4, "only": 1},
    ),
}
CASES5: dict[str, tuple[list[Line], dict[str, float | None]]] = {
    "the same assertion twice is one": (
        [("cup", "AtLocation", "kitchen", 2.0), ("cup", "AtLocation", "kitchen", 2.0)],
        {"Cup in Kitchen": 2, "only": 1},
    ),
    "the source names the sense": (
        [
            ("mouse/n/wn/animal", "AtLocation", "attic", 4.0),
            ("mouse/n/wn/artifact", "AtLocation", "office", 4.0),
            ("banana/n/wn/plant", "AtLocation", "garden", 4.0),
            ("banana/n/wn/food", "AtLocation", "kitchen", 4.0),
            ("fork/v", "AtLocation", "kitchen", 4.0),
        ],
        {
            "Mouse in Attic": None,
            "Mouse in Office": True,
            "Banana in Kitchen": True,
            "Fork in Kitchen": None,
        },
    ),
    "a doubtful name counts half and a synonym becomes one": (
        [
            ("notebook", "AtLocation", "office", weight_of(8)),
            ("settle", "Synonym", "couch", 2.0),
            ("settle", "AtLocation", "lobby", weight_of(8)),
            ("fork", "Synonym", "knife", 2.0),  # names another category: no synonym of ours
            ("fork", "AtLocation", "pantry", weight_of(8)),
        ],
        {"Laptop in Office": 4, "Couch in Lobby": 4, "Knife in Pantry": None},
    ),
}


@pytest.mark.parametrize(
    ("write", "case"), [*((graph4, case) for case in CASES4), *((tsv5, case) for case in CASES5)]
)
def test_what_assertions_come_to(write: Callable[..., Path], case: str, tmp_path: Path) -> None:
    lines, expected = (CASES4 | CASES5)[case]
    found = relations_of(import_conceptnet(write(tmp_path / "file", *lines)))
    for name, votes in expected.items():
        if votes is None:
            assert name not in found
        elif name != "only":
            assert name in found
            if votes is not True:
                assert found[name].weight == pytest.approx(weight_of(votes), abs=1e-2)
    if "only" in expected:
        assert found.keys() == expected.keys() - {"only"}


def test_synonyms_and_spellings_add_their_votes(tmp_path: Path) -> None:
    path = graph4(
        tmp_path / "g",
        ("tv", "AtLocation", "live room", 4),
        ("television", "AtLocation", "livingroom", 1),
        ("tv set", "AtLocation", "work out", 9),
        ("tv", "AtLocation", "live room", 2),  # a duplicate is other people's votes
    )
    found = relations_of(import_conceptnet(path))["Tv in LivingRoom"]
    assert found.weight == pytest.approx(weight_of(7), abs=1e-3)
    assert found.probability == pytest.approx(probability_of(found.weight), abs=1e-3)
    assert found.surfaces == ("tv AtLocation live room", "television AtLocation livingroom")
    assert found.sources[0].startswith("https://conceptnet.io/a/")


def test_a_negated_relation_speaks_against(tmp_path: Path) -> None:
    lines = [("cup", "AtLocation", "kitchen", 6.0), ("cup", "NotAtLocation", "kitchen", 1.0)]
    found = relations_of(import_conceptnet(tsv5(tmp_path / "t", *lines)))["Cup in Kitchen"]
    assert (found.weight, found.weight_against) == (6.0, 1.0)
    assert found.probability == pytest.approx(probability_of(5), abs=1e-3)


def test_other_languages_are_not_ours(tmp_path: Path) -> None:
    path = tsv5(tmp_path / "t", ("cup", "AtLocation", "kitchen", 4.0))
    assert import_conceptnet(path, language="de").found == ()
    path.write_text(path.read_text().replace("/c/en/", "/c/de/"))
    assert import_conceptnet(path).found == ()
    assert relations_of(import_conceptnet(path, language="de")).keys() == {"Cup in Kitchen"}


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
    found = relations_of(imported)
    assert found.keys() >= {
        *("Bed in Bedroom", "Tv in LivingRoom", "Laptop in Office", "Sink in Kitchen"),
        *("Toilet in Shower", "Banana in Pantry", "Mouse in Office", "Vase in DiningRoom"),
    }
    assert found.keys().isdisjoint(
        {
            *("Mouse in Attic", "Mouse in Kitchen", "Kite in Attic", "Boat in Dam"),
            *("Bed in HotelOutdoor", "DiningTable in Office", "SportsBall in Ballroom"),
            *("Cow in ButchersShop", "Tv in OfficeBuilding", "Fork in Airplane"),
        }
    )


def test_both_formats_of_the_same_data_agree(tmp_path: Path) -> None:
    lines: list[Line] = [("cup", "AtLocation", "kitchen", 9), ("bed", "AtLocation", "bedroom", 4)]
    lines += [("fork", "LocatedNear", "knife", 2), ("banana", "IsA", "food", 5)]
    four = relations_of(import_conceptnet(graph4(tmp_path / "four", *lines)))
    weighed = [(start, relation, end, weight_of(votes)) for start, relation, end, votes in lines]
    five = relations_of(import_conceptnet(tsv5(tmp_path / "five", *weighed)))
    assert four.keys() == five.keys()
    assert len(four) > len(lines)
    assert all(four[name].weight == pytest.approx(five[name].weight, rel=0.01) for name in four)
