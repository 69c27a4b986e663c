"""A past state of a map becomes its present one, whole or in part, and the history keeps both."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from pyoxigraph import Quad

from hereabouts.cli import main
from kg.history.timestamps import iso
from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import PerceivedObjects
from kg.model import vocabulary as v
from kg.model.errors import (
    GraphError,
    HistoryError,
    OntologyError,
    QueryParameterError,
    ShapeError,
    UnconfirmedDeletionError,
)
from kg.model.records import MapUpdate
from kg.serving.opening import in_memory_map, open_map
from tests.kg.conftest import thing

BASE = "https://example.org/flat/"
EVERYTHING = "DELETE WHERE { ?s ?p ?o }"
Written = Callable[[int], SemanticMap]
Frame = Callable[..., MapUpdate]


def facts(semantic_map: SemanticMap) -> set[Quad]:
    """All quads but the number of the last transaction."""
    return {quad for quad in semantic_map.engine if quad.predicate.value != v.SEQUENCE}


@pytest.fixture
def flat(written: Written) -> Iterator[SemanticMap]:
    with written(5) as semantic_map:
        yield semantic_map


def test_a_map_that_was_emptied_is_restored_quad_for_quad(flat: SemanticMap) -> None:
    flat.assertions.add(f"{BASE}object/1", "category", "cup", by="ann")
    before, number = facts(flat), flat.sequence
    flat.update(EVERYTHING, by="bob", confirmed=True)
    assert not flat.objects()
    done = flat.restore(f"#{number}", by="ann")
    assert facts(flat) == before
    assert (done.restored, done.sequence) == (number, number + 2)
    assert (done.objects_back, done.objects_gone, done.places_back) == (2, 0, 1)
    (change,) = flat.history.changes(number + 1)
    assert (change.cause.kind, change.cause.by) == ("restore", "ann")
    assert (len(change.added), len(change.removed)) == (done.added, done.removed)
    with flat.at(number + 1) as emptied:
        assert not emptied.objects(), "the history keeps what was undone"
    with flat.at(number) as then:
        assert facts(then) == before


def test_a_moment_is_named_by_its_time_too(flat: SemanticMap) -> None:
    (change,) = flat.history.changes(4)
    flat.update("DELETE WHERE { <object/1> ?p ?o }")
    flat.restore(iso(change.time))
    assert len(flat.objects()) == 2


def test_nothing_is_written_where_nothing_differs_and_in_a_dry_run(flat: SemanticMap) -> None:
    number = flat.sequence
    assert flat.restore(number).sequence is None
    done = flat.restore(1, dry_run=True)
    assert done.sequence is None and done.added > 0 and done.removed > 0
    assert flat.sequence == number


def test_object_numbers_are_never_given_out_twice(flat: SemanticMap) -> None:
    new = flat.new_object_iri()
    flat.apply(MapUpdate(objects=(replace(flat.objects()[0], iri=new, evidence=None),)))
    flat.restore(5)
    assert {record.iri for record in flat.objects()} == {f"{BASE}object/1", f"{BASE}object/2"}
    assert int(flat.new_object_iri().rpartition("/")[2]) > int(new.rpartition("/")[2])


def test_frames_written_after_it_are_as_if_never_interrupted(flat, frame):
    objects = PerceivedObjects(flat)
    flat.update(EVERYTHING, confirmed=True)
    objects.refresh()
    assert not objects
    flat.restore(5)
    objects.refresh()
    assert set(objects) == {f"{BASE}object/1", f"{BASE}object/2"}
    flat.apply(frame(5))
    with in_memory_map(base=BASE) as uninterrupted:
        for number in range(6):
            uninterrupted.apply(frame(number))
        ours, theirs = (
            {q for q in facts(m) if q.graph_name == v.MAP_GRAPH} for m in (flat, uninterrupted)
        )
        assert ours == theirs


def test_one_object_comes_back_with_all_that_belonged_to_it(flat: SemanticMap) -> None:
    flat.assertions.add(f"{BASE}object/1", "label", "Ann's chair", by="ann")
    before, number = facts(flat), flat.sequence
    flat.update("DELETE WHERE { <object/1> ?p ?o }")
    flat.assertions.add(f"{BASE}object/2", "category", "cup", by="bob")
    done = flat.restore(number, only=["object/1"])
    assert (done.objects_back, done.removed) == (1, 0)
    assert {r.iri for r in flat.objects("cup")} == {f"{BASE}object/2"}, "others stay as they are"
    about = f"{BASE}object/1"
    ends = {q: {getattr(term, "value", "") for term in (q.subject, q.object)} for q in before}
    mine = {quad for quad in before if about in ends[quad]}
    assert mine and mine <= facts(flat)
    assert {a.by for a in flat.assertions.all("object/1")} == {"ann"}
    flat.restore(5)
    flat.restore(number, only=["object/1"])
    assert {a.by for a in flat.assertions.all("object/1")} == {"ann"}, "an author comes back too"


def test_objects_and_places_are_restored_apart(flat: SemanticMap) -> None:
    flat.update("DELETE WHERE { <object/1> ?p ?o }")
    flat.update(
        'DELETE { <place/1> rdfs:label ?l } INSERT { <place/1> rdfs:label "hall" } '
        "WHERE { <place/1> rdfs:label ?l }"
    )
    flat.restore(5, only=["objects"])
    assert len(flat.objects()) == 2
    assert [place.label for place in flat.places()] == ["hall"]
    flat.restore(5, only=["places"])
    assert [place.label for place in flat.places()] == ["place 1"]


def test_assertions_come_back_over_what_perception_believes_now(flat, frame):
    flat.assertions.add(f"{BASE}object/1", "category", "cup", by="ann")
    number = flat.sequence
    flat.assertions.retract(f"{BASE}object/1", "category", by="bob")
    flat.assertions.add(f"{BASE}object/2", "label", "bob's", by="bob")
    flat.apply(frame(5))
    done = flat.restore(number, only=["assertions"])
    assert done.skipped == ()
    one, two = flat.objects()
    assert one.category == flat.catalogue.find("cup").iri
    assert one.observations == 6, "perception's latest belief stays"
    (said,) = flat.assertions.all()
    assert (said.by, said.value) == ("ann", one.category)
    assert two.category == v.HERE + "Chair"


def test_assertions_of_what_is_gone_stay_away_and_are_named(flat: SemanticMap) -> None:
    flat.assertions.add(f"{BASE}object/1", "label", "Ann's", by="ann")
    number = flat.sequence
    flat.update("DELETE WHERE { <object/1> ?p ?o }")
    done = flat.restore(number, only=["assertions"])
    assert done.skipped == (f"{BASE}object/1",)
    assert not flat.assertions.all()


def test_the_ontology_is_restored_and_known(flat: SemanticMap) -> None:
    before, number = facts(flat), flat.sequence
    flat.ontology.learn(["gramophone"], "object", model="net")
    assert flat.catalogue.for_label("gramophone", "object") is not None
    flat.restore(number)
    assert flat.catalogue.for_label("gramophone", "object") is None
    assert facts(flat) == before
    assert flat.ontology.learn(["gramophone"], "object", model="net"), "a mapper can learn it again"


def test_an_ontology_that_lacks_what_the_map_uses_is_refused(flat: SemanticMap) -> None:
    number = flat.sequence
    found = flat.ontology.learn(["gramophone"], "object", model="net")
    flat.apply(MapUpdate(objects=(replace(flat.objects()[0], category=found["gramophone"]),)))
    before = facts(flat)
    with pytest.raises(OntologyError, match="Gramophone"):
        flat.restore(number, only=["ontology"])
    assert facts(flat) == before


def test_a_part_that_does_not_fit_the_rest_is_refused(flat: SemanticMap) -> None:
    number = flat.sequence
    flat.update("DELETE WHERE { <place/1> ?p ?o }")
    flat.update("DELETE WHERE { <object/1> ?p ?o }")
    before = facts(flat)
    with pytest.raises(ShapeError, match=r"place/1|inPlace"):
        flat.restore(number, only=["object/1"])
    assert facts(flat) == before


def test_what_cannot_be_restored_is_one_line(flat: SemanticMap) -> None:
    for when in ("#99", "someday", "yesterday"):
        with pytest.raises(HistoryError):
            flat.restore(when)
    with pytest.raises(QueryParameterError, match="there are objects, places, assertions"):
        flat.restore(1, only=["everything else"])
    path = Path(flat.store.where)
    flat.close()
    with open_map(path, read_only=True) as reader, pytest.raises(GraphError):
        reader.restore(1)


def test_a_restoration_that_deletes_much_asks_too() -> None:
    with in_memory_map(base=BASE) as home:
        home.apply(MapUpdate())
        home.ontology.learn(["gramophone"], "object", model="net")
        number = home.sequence
        home.apply(MapUpdate(objects=tuple(thing(home) for _ in range(12))))
        with pytest.raises(UnconfirmedDeletionError, match="12 of 12"):
            home.restore(number)
        assert home.restore(number, confirmed=True).objects_gone == 12


def test_the_command_restores_and_counts(flat, capsys):
    path, before = flat.store.where, facts(flat)
    flat.update(EVERYTHING, confirmed=True)
    flat.close()
    assert main(["restore", path, "--to", "#5", "--dry-run"]) == 0
    assert "dry run, restores #5:" in capsys.readouterr().err
    assert main(["restore", path, "--to", "#5", "--by", "ann"]) == 0
    assert "2 objects back, 0 removed; 1 place back, 0 removed" in capsys.readouterr().err
    assert main(["restore", path, "--to", "#500"]) == 1
    assert capsys.readouterr().err.startswith("error: no transaction #500 is kept")
    with open_map(path) as again:
        assert facts(again) == before
