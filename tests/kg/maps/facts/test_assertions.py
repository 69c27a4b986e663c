"""What people said outranks what is perceived, until it is retracted."""

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError, UnknownCategoryError
from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import in_memory_map
from tests.kg.conftest import thing

BASE = "http://m/"


@pytest.fixture
def home() -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as made:
        kitchen, attic = (made.catalogue.find(c).iri for c in ("kitchen", "attic"))
        record = thing(made, existence=0.33)
        place = PlaceRecord(f"{BASE}place/1", "den", 0, 5, 0, 5, 4, {kitchen: 0.7, attic: 0.3})
        made.apply(MapUpdate(objects=(record,), places=(place,)))
        yield made
        assert check_map(made.engine) == []


def label(home: SemanticMap, thing: str) -> object:
    ((text,),) = home.query(
        f"SELECT ?l WHERE {{ GRAPH graph:map {{ <{BASE}{thing}> rdfs:label ?l }} }}"
    ).rows
    return text


def test_who_said_what_and_when_is_kept(home: SemanticMap) -> None:
    change = home.assertions.add("object/1", "category", "bowl", by="ann")
    assert change is not None
    assert (change.cause.kind, change.cause.by) == ("assert", "ann")
    (row,) = home.query("assertions").records()
    told = tuple(row[name] for name in ("thing", "asserted", "perceived", "by"))
    assert told == (f"{BASE}object/1", "bowl", "cup", "ann")
    (said,) = home.assertions.all("object/1")
    assert abs(said.stamp - change.time) < 2


def test_a_conflict_says_since_when_and_how_strongly(home: SemanticMap) -> None:
    home.assertions.add("object/1", "category", "bowl", by="ann")
    home.assertions.add("place/1", "category", "bedroom", by="bob")
    strong, weak = home.query("conflicts").records()
    told = tuple(strong[name] for name in ("property", "perceived", "strength"))
    assert told == ("category", "kitchen", 0.7)
    assert (weak["label"], weak["asserted"], weak["strength"]) == ("bowl 1", "bowl", 0.33)
    (first,) = (c for c in home.assertions.conflicts() if c.subject.endswith("object/1"))
    (perceived,) = home.perceived.objects()
    home.apply(MapUpdate(objects=(replace(perceived, existence=0.9),)))
    (later,) = (c for c in home.assertions.conflicts() if c.subject.endswith("object/1"))
    assert (later.since, later.strength) == (first.since, 0.9)


def test_a_conflict_ends_when_perception_comes_round(home: SemanticMap) -> None:
    home.assertions.add("object/1", "position", (4, 4, 0.5), by="ann")
    assert len(home.assertions.conflicts()) == 1
    (perceived,) = home.perceived.objects()
    home.apply(MapUpdate(objects=(replace(perceived, p_map=np.array([4.1, 4.0, 0.5])),)))
    assert home.assertions.conflicts() == ()
    assert home.objects()[0].p_map.tolist() == [4.0, 4.0, 0.5]
    home.assertions.retract("object/1", "position", by="ann")
    assert home.objects()[0].p_map.tolist() == [4.1, 4.0, 0.5]


def test_a_thing_that_is_seen_contradicts_its_absence_and_agrees_with_its_presence(home):
    home.assertions.add("object/1", "existence", "absent", by="ann")
    (conflict,) = home.assertions.conflicts()
    assert (conflict.value, conflict.perceived, conflict.strength) == ("absent", "0.33", 0.33)
    home.assertions.add("object/1", "existence", "present", by="ann")
    assert home.assertions.conflicts() == ()


def test_an_asserted_position_is_in_its_place(home: SemanticMap) -> None:
    home.assertions.add("object/1", "position", "1, 1, 0", by="ann")
    assert home.objects()[0].place == f"{BASE}place/1"
    home.assertions.add("object/1", "position", "9 1 0", by="ann")
    assert home.objects()[0].place is None


def test_an_asserted_extent_outranks_later_boxes_of_perception(home: SemanticMap) -> None:
    (perceived,) = home.perceived.objects()
    seen = replace(perceived, extent=np.array([0.3, 0.2, 0.1]), yaw=0.2)
    home.apply(MapUpdate(objects=(seen,)))
    home.assertions.add("object/1", "extent", "1.2, 0.8, 0.75, -0.4", by="ann")
    later = replace(seen, extent=np.array([0.4, 0.2, 0.1]), yaw=0.3)
    home.apply(MapUpdate(objects=(later,)))
    (believed,) = home.objects()
    assert believed.extent is not None
    assert (believed.extent.tolist(), believed.yaw) == ([1.2, 0.8, 0.75], -0.4)
    (conflict,) = home.assertions.conflicts()
    assert (conflict.value, conflict.perceived) == ("1.2 0.8 0.75 -0.4", "0.4 0.2 0.1 0.3")
    (told,) = home.history.explain("object/1 here:yaw")
    assert any(step.kind == "person" for _, step in told.walk())
    home.assertions.retract("object/1", "extent", by="ann")
    (restored,) = home.objects()
    assert restored.extent is not None
    assert (restored.extent.tolist(), restored.yaw) == ([0.4, 0.2, 0.1], 0.3)


def test_an_update_of_an_asserted_extent_is_the_new_assertion(home: SemanticMap) -> None:
    home.assertions.add("object/1", "extent", (1, 2, 3), by="ann")
    home.update(
        "DELETE { ?o here:extentX ?x } INSERT { ?o here:extentX 1.5e0 ; here:yaw 0.5e0 } "
        "WHERE { ?o here:extentX ?x }",
        by="bob",
    )
    (said,) = home.assertions.all("object/1")
    assert (said.value, said.by) == ("1.5 2 3 0.5", "bob")


def test_a_flat_box_of_perception_hinders_no_assertion(home: SemanticMap) -> None:
    home.assertions.add("object/1", "category", "bowl", by="ann")
    (perceived,) = home.perceived.objects()
    home.apply(MapUpdate(objects=(replace(perceived, extent=np.array([0.3, 0.0, 0.1])),)))
    home.assertions.add("object/1", "extent", "1 2 3", by="ann")
    assert home.assertions.conflicts()


def test_a_label_is_said_and_taken_back(home: SemanticMap) -> None:
    home.assertions.add("object/1", "label", "Ada's mug", by="ann")
    home.assertions.add("object/1", "category", "bowl", by="ann")
    assert label(home, "object/1") == "Ada's mug"
    home.assertions.retract("object/1", "label")
    assert label(home, "object/1") == "bowl 1"
    home.assertions.add("place/1", "label", "the nook", by="ann")
    home.apply(MapUpdate(places=home.perceived.places()))
    assert label(home, "place/1") == "the nook"
    home.assertions.retract("place/1", "label")
    assert label(home, "place/1") == "den"


def test_an_asserted_place_takes_all_belief_and_gives_it_back(home: SemanticMap) -> None:
    before = home.places()[0].beliefs
    home.assertions.add("place/1", "category", "bedroom", by="ann")
    assert home.places()[0].beliefs == {home.catalogue.find("bedroom").iri: 1.0}
    assert home.perceived.places()[0].beliefs == before
    home.assertions.retract("place/1", "category", by="ann")
    assert home.places()[0].beliefs == before
    assert home.query("places").records()[0]["category"] == "kitchen"


def test_all_is_as_before_when_all_is_taken_back(home: SemanticMap) -> None:
    def believed() -> set[tuple[object, ...]]:
        return set(home.query("SELECT ?s ?p ?o WHERE { GRAPH graph:map { ?s ?p ?o } }").rows)

    before = believed()
    everything = {
        "object/1": {"category": "bowl", "position": "3 3 3", "existence": "absent", "label": "x"},
        "place/1": {"category": "attic", "label": "x"},
    }
    for name, properties in everything.items():
        for prop, value in properties.items():
            home.assertions.add(name, prop, value, by="ann")
    assert len(home.assertions.all()) == 6
    for name, properties in everything.items():
        for prop in properties:
            home.assertions.retract(name, prop, by="bob")
    home.apply(MapUpdate(objects=(replace(home.perceived.objects()[0], place=None),)))
    assert believed() == before
    assert home.assertions.all() == ()


def test_said_again_it_is_no_change_but_who_and_when(home, monkeypatch):
    home.assertions.add("object/1", "category", "bowl", by="ann")
    (first,) = home.assertions.all()
    assert first.since is not None
    later = first.stamp + 3600
    monkeypatch.setattr(time, "time", lambda: later)
    home.assertions.add("object/1", "category", "bowl", by="bob")
    (second,) = home.assertions.all()
    assert (second.by, second.perceived, second.since) == ("bob", first.perceived, first.since)
    assert second.stamp == pytest.approx(later, abs=1)


def test_things_with_any_iri_can_be_spoken_of(home: SemanticMap) -> None:
    mine = "http://example.org/my cup?#1".replace(" ", "%20")
    home.update(f"INSERT DATA {{ <{mine}> a here:Cup ; here:x 1 ; here:y 1 }}", by="ann")
    home.assertions.add(mine, "category", "bowl", by="ann")
    (said,) = home.assertions.all(mine)
    assert said.subject == mine
    home.assertions.retract(mine, "category", by="ann")
    assert home.assertions.all() == ()


REFUSED = (
    ("object/9", "category", "bowl", "no object or place http://m/object/9"),
    ("object/1", "colour", "red", "category, position, extent, existence, label"),
    ("place/1", "position", "1 2 3", "of places cannot be asserted"),
    *(("object/1", "position", given, "three finite numbers") for given in ("1 2", "1 2 nan")),
    *(("object/1", "extent", given, "three lengths") for given in ("1 2", "1 2 -3", "1 2 3 4")),
    *(("object/1", "extent", given, "three lengths") for given in ("wide", (1, 2, math.nan))),
    ("object/1", "position", "1e7 2 0", "up to 1e"),
    ("object/1", "existence", "maybe", "present or absent"),
    ("object/1", "label", " ", "at least one character"),
    ("object/1", "label", ["cup", {}], "label of a thing is a text"),
    ("object/1", "name", [1, 2, 3], "name of a thing is a text"),
)


def test_what_cannot_be_said_is_refused(home: SemanticMap) -> None:
    for name, prop, value, told in REFUSED:
        with pytest.raises(InvalidFactError, match=told):
            home.assertions.add(name, prop, value, by="ann")
    assert home.assertions.all() == ()


def test_an_unknown_category_and_a_nameless_speaker_are_refused(home: SemanticMap) -> None:
    with pytest.raises(UnknownCategoryError, match="did you mean bowl"):
        home.assertions.add("object/1", "category", "bowll", by="ann")
    with pytest.raises(UnknownCategoryError, match="that is a place"):
        home.assertions.add("object/1", "category", "kitchen", by="ann")
    with pytest.raises(InvalidFactError, match="by='ann'"):
        home.assertions.add("object/1", "category", "bowl", by=" ")
    with pytest.raises(InvalidFactError, match=r"the category of .* is not asserted"):
        home.assertions.retract("object/1", "category")


def test_what_is_no_unicode_is_refused_and_changes_nothing(home: SemanticMap) -> None:
    before = home.sequence
    for value, by in (("\udcff", "ann"), ("mug", "\udcff")):
        with pytest.raises(InvalidFactError, match="visible characters"):
            home.assertions.add("object/1", "label", value, by=by)
    with pytest.raises(InvalidFactError, match="Unicode"):
        home.update("INSERT DATA { <object/1> rdfs:comment 'x' }", by="\udcff")
    assert home.sequence == before == home.history.log.last
    assert home.assertions.all("object/1") == ()
    assert home.assertions.add("object/1", "label", "mug", by="ann") is not None
