"""The placement table of a real map: what speaks, how much, and what seeing rooms changes."""

from pathlib import Path

import numpy as np
import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from kg.knowledge.ontology.relations import mark_of
from kg.knowledge.placement.statistics import (
    SHIPPED,
    RoomStatistics,
    read_rooms,
    statistics,
    statistics_quads,
    table_quads,
)
from kg.knowledge.placement.table import table_of
from kg.maps.room_statistics import import_rooms, placement_table
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import OntologyError, UnknownCategoryError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from tests.shipped_ontology import CATALOGUE, QUADS

TABLE = table_of(QUADS)
HOMES = """room,n_rooms,object,rooms_with_object
kitchen,100,oven,80
bathroom,200,toilet,180
toilet,10,toilet,9
hall/stairwell,50,chair,10
"""


def iri(label: str) -> str:
    return CATALOGUE.find(label).iri


def place(label: str) -> str:
    return CATALOGUE.find(label, "place").iri


@pytest.fixture
def homes(tmp_path: Path) -> Path:
    (tmp_path / "homes.csv").write_text(HOMES)
    return tmp_path / "homes.csv"


def room(number: int, category: str, views: int = 9) -> PlaceRecord:
    beliefs = {place(category): 1.0}
    edge = float(10 * number)
    base = f"https://example.org/m/place/{number}"
    return PlaceRecord(base, f"place {number}", edge, edge + 5, 0, 5, views, beliefs)


def thing(number: int, category: str, where: PlaceRecord, existence: float = 1.0) -> ObjectRecord:
    p = np.array([where.xmin + 1, 1, 0.5])
    name = f"https://example.org/m/object/{number}"
    return ObjectRecord(name, iri(category), p, 2, existence, 3, 1.0, 2.0, where.iri)


def test_a_listed_pair_that_conceptnet_says_nothing_of_is_a_little_likelier() -> None:
    wine = TABLE.placement(iri("wine glass"), place("dining room"))
    assert 0.04 < wine.probability < 0.2
    assert TABLE.probability(iri("wine glass"), place("volcano")) < wine.probability / 1.5
    assert sum(r.share for r in wine.reasons) == pytest.approx(1)
    assert any(r.source.startswith("thesis") for r in wine.reasons)
    assert wine.alpha / (wine.alpha + wine.beta) == pytest.approx(wine.probability)


def test_conceptnet_speaks_as_shipped_until_somebody_imports_it() -> None:
    bed = iri("bed"), place("bedroom")
    assert TABLE.probability(*bed) > 0.5  # the thesis has no such edge
    assert any(r.source.startswith("ConceptNet") for r in TABLE.placement(*bed).reasons)
    table = table_of([*QUADS, *_imported("banana", "kitchen", weight=5.0)])
    assert table.probability(*bed) < TABLE.probability(*bed)  # it says nothing of beds
    sources = {reason.source for reason in table.placement(*bed).reasons}
    assert not any(source.startswith("ConceptNet") for source in sources)
    assert {"BEHAVIOR-1K homes", "COCO val2017"} <= sources


def _imported(thing: str, where: str, weight: float) -> list[Quad]:
    """A relation as the importer writes it, with its mark."""
    subject, target = NamedNode(iri(thing)), NamedNode(place(where))
    notes: list[tuple[str, NamedNode | Literal]] = [
        (v.OWL_ANNOTATED_SOURCE, subject),
        (v.OWL_ANNOTATED_PROPERTY, NamedNode(v.LOCATED_AT)),
        (v.OWL_ANNOTATED_TARGET, target),
        (v.PROBABILITY, Literal(0.5)),
        (v.WEIGHT, Literal(weight)),
    ]
    notes.append((v.IMPORT_MARK, Literal(mark_of(notes))))
    axiom, graph = BlankNode(), v.ONTOLOGY_GRAPH
    stated = [Quad(subject, NamedNode(v.LOCATED_AT), target, graph)]
    kind = Quad(axiom, v.RDF_TYPE, NamedNode(v.OWL_AXIOM), graph)
    return [*stated, kind, *(Quad(axiom, NamedNode(p), o, graph) for p, o in notes)]


def test_a_supercategory_is_at_least_as_likely_as_each_member() -> None:
    food = TABLE.probability(iri("food"), place("kitchen"))
    assert TABLE.probability(iri("banana"), place("kitchen")) < food < 1


def test_what_is_no_kind_of_object_is_refused_and_an_unknown_place_is_not() -> None:
    with pytest.raises(UnknownCategoryError):
        TABLE.probability("https://example.org/nothing", place("kitchen"))
    with pytest.raises(UnknownCategoryError):
        TABLE.probability(place("kitchen"), place("kitchen"))
    assert 0 < TABLE.probability(iri("cup"), "https://example.org/attic") < 0.1


def test_rooms_seen_without_an_object_lower_it_and_with_it_raise_it(semantic_map):
    def told() -> float:
        return placement_table(semantic_map).probability(iri("oven"), place("kitchen"))

    values = [told()]
    semantic_map.apply(MapUpdate(places=(room(9, "kitchen", views=2),)))
    assert told() == pytest.approx(values[0])  # hardly looked at
    rooms = [room(number, "kitchen") for number in range(4)]
    for number in range(3):
        semantic_map.apply(MapUpdate(places=(rooms[number],)))
        values.append(told())
    assert values == sorted(values, reverse=True)
    assert len(set(values)) == 4
    semantic_map.apply(MapUpdate(objects=(thing(1, "oven", rooms[0]),)))
    assert told() > values[-1]
    reasons = placement_table(semantic_map).placement(iri("oven"), place("kitchen")).reasons
    assert "this map" in {reason.source for reason in reasons}


def test_what_a_detector_cannot_see_is_not_missed(semantic_map: SemanticMap) -> None:
    semantic_map.apply(MapUpdate(places=(room(0, "kitchen"),)))
    table = placement_table(semantic_map, sought={iri("cup")})
    assert table.probability(iri("oven"), place("kitchen")) == pytest.approx(
        TABLE.probability(iri("oven"), place("kitchen"))
    )
    cup = table.probability(iri("cup"), place("kitchen"))
    assert cup < TABLE.probability(iri("cup"), place("kitchen"))


def test_a_person_may_state_a_probability(semantic_map: SemanticMap) -> None:
    before = placement_table(semantic_map).probability(iri("cup"), place("office"))
    edge = "here:Cup here:locatedAt here:Office"
    axiom = (
        "<https://example.org/said> a owl:Axiom ; owl:annotatedSource here:Cup ; "
        "owl:annotatedProperty here:locatedAt ; owl:annotatedTarget here:Office ; "
        'here:probability 0.9e0 ; dct:source "ann"'
    )
    semantic_map.update(
        f"INSERT DATA {{ GRAPH graph:ontology {{ {edge} . {axiom} }} }}", allow=("ontology",)
    )
    said = placement_table(semantic_map).placement(iri("cup"), place("office"))
    assert before < 0.6 < said.probability < 0.9
    assert said.reasons[0].source == "ann"


def test_statistics_in_a_map_speak_and_importing_twice_changes_nothing(semantic_map, homes):
    before = placement_table(semantic_map)
    relations = len(semantic_map.query("located-at", category="food").rows)
    table = read_rooms(homes, semantic_map.catalogue, "homes")
    assert import_rooms(semantic_map, table) > 0
    assert import_rooms(semantic_map, table) == 0
    after = placement_table(semantic_map)
    oven = iri("oven"), place("kitchen")
    assert before.probability(*oven) < 0.72 < 0.75 < after.probability(*oven) < 0.85
    assert after.placement(*oven).reasons[0].text == "80 of 100 rooms"
    assert len(semantic_map.query("located-at", category="food").rows) == relations
    toilet = semantic_map.catalogue.find("toilet", "place")
    assert after.probability(iri("toilet"), toilet.iri) > 0.8
    homes.write_text(HOMES.replace("100,oven,80", "100,oven,20"))  # a newer table replaces it
    import_rooms(semantic_map, read_rooms(homes, semantic_map.catalogue, "homes"))
    found = placement_table(semantic_map).placement(*oven)
    assert found.reasons[0].text == "20 of 100 rooms"


def test_an_object_a_source_never_names_is_not_counted_as_absent(homes: Path) -> None:
    table = read_rooms(homes, CATALOGUE, "homes")
    known = table_of([*QUADS, *table_quads(table)])
    banana = iri("banana"), place("kitchen")
    assert known.probability(*banana) == pytest.approx(TABLE.probability(*banana))
    bed = known.probability(iri("oven"), place("shower"))
    assert bed < 0.02


def test_near_follows_stated_relations_places_and_rooms_seen(semantic_map: SemanticMap) -> None:
    apple, banana = iri("apple"), iri("banana")
    assert TABLE.near(apple, banana) > TABLE.near(iri("toilet"), banana)
    rooms = [room(number, "kitchen") for number in range(3)]
    bananas = tuple(thing(n, "banana", where) for n, where in enumerate(rooms))
    semantic_map.apply(MapUpdate(places=tuple(rooms), objects=bananas))
    assert placement_table(semantic_map).near(apple, banana) < TABLE.near(apple, banana)


def test_an_oven_and_a_sink_make_a_kitchen_of_a_room(homes: Path) -> None:
    table = table_of([*QUADS, *table_quads(read_rooms(homes, CATALOGUE, "homes"))])
    found = table.place_posterior({iri("oven"): 1, iri("sink"): 2}, dict.fromkeys(table.places, 1))
    assert max(found, key=lambda k: found[k]) == place("kitchen")
    assert sum(found.values()) == pytest.approx(1)
    prior = {place("bedroom"): 0.5, place("kitchen"): 0.5}
    assert table.place_posterior({}, prior) == pytest.approx(prior)
    assert table.place_posterior({iri("oven"): 1}, prior)[place("kitchen")] > 0.7
    with pytest.raises(UnknownCategoryError, match="prior"):
        table.place_posterior({}, {"https://example.org/attic": 1.0})


def test_statistics_come_back_from_quads_as_they_went_in() -> None:
    one = RoomStatistics("a/b é", place("kitchen"), iri("oven"), 5, 3, "https://example.org/l")
    assert statistics(statistics_quads([one])) == (one,)
    wrong = RoomStatistics("s", place("kitchen"), iri("oven"), 5, 6)
    with pytest.raises(OntologyError, match="has 5 and 6"):
        statistics(statistics_quads([wrong]))


def test_the_shipped_table_of_offices_reads(semantic_map: SemanticMap) -> None:
    path, source, licence = SHIPPED["s3dis"]
    import_rooms(semantic_map, read_rooms(path, semantic_map.catalogue, source, licence))
    found = placement_table(semantic_map)
    assert found.probability(iri("chair"), place("office")) > 0.85
    assert found.probability(iri("couch"), place("office")) < 0.3
