"""Validation of updates, and the guard of deletions."""

from collections.abc import Iterator

import numpy as np
import pytest
import rdflib
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode, Store

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.maps.update.change_draft import ChangeDraft
from kg.maps.update.execution import evaluate_update
from kg.maps.update.validation import DeletionLimit
from kg.model import vocabulary as v
from kg.model.errors import ProtectedError, ShapeError, UnconfirmedDeletionError
from kg.model.records import Evidence, MapUpdate, PlaceRecord, RecordingRecord
from kg.serving.opening import in_memory_map
from tests.kg.conftest import thing

BASE = "http://m/"


def fill(made: SemanticMap) -> None:
    kitchen, attic = (made.catalogue.find(c).iri for c in ("kitchen", "attic"))
    evidence = Evidence("frame-1", "walk", 50.0, (1, 2, 3, 4), 0.8, "net")
    seen = {"place": f"{BASE}place/1", "evidence": evidence, "existence": 0.33}
    objects = tuple(thing(made, p_map=np.array([x, 1.0, 0.5]), **seen) for x in (1.0, 3.0))
    place = PlaceRecord(f"{BASE}place/1", "place 1", 0, 5, 0, 5, 2, {kitchen: 0.7, attic: 0.3})
    recording = RecordingRecord("walk", 2, "frame-1", np.eye(4))
    made.apply(MapUpdate(objects=objects, places=(place,), recording=recording))


@pytest.fixture
def home() -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as made:
        fill(made)
        yield made


@pytest.fixture(scope="module")
def unchanged() -> Iterator[SemanticMap]:
    """A map for updates that are refused."""
    with in_memory_map(base=BASE) as made:
        fill(made)
        yield made


def said(home: SemanticMap, iri: str) -> dict[str, str]:
    rows = home.query(f"SELECT ?p ?o WHERE {{ GRAPH graph:map {{ <{iri}> ?p ?o }} }}").rows
    return {str(p).replace(v.HERE, "here:"): str(o) for p, o in rows}


def test_an_object_given_by_class_and_position_is_completed(home: SemanticMap) -> None:
    change = home.update(
        "INSERT DATA { <http://m/object/9> a here:Cup ; here:x 6 ; here:y 1.25 }", by="ann"
    )
    assert change is not None
    assert (change.cause.kind, change.cause.by) == ("update", "ann")
    assert "here:Cup" in change.cause.note
    assert said(home, "http://m/object/9").keys() >= {"here:z", "here:existence", "here:lastSeen"}
    assert said(home, "http://m/object/9")["here:inCell"].endswith("/1_0")
    (record,) = (o for o in home.objects() if o.iri.endswith("/9"))
    assert (record.p_map.tolist(), record.existence) == ([6.0, 1.25, 0.0], 1.0)
    assert home.new_object_iri() == "http://m/object/10"
    assert check_map(home.engine) == []


def test_a_place_given_by_class_and_rectangle_is_completed(home: SemanticMap) -> None:
    home.update(
        "INSERT DATA { <http://m/place/2> a here:Attic ; "
        "here:xMin 5 ; here:xMax 9 ; here:yMin 0 ; here:yMax 4 }",
        by="ann",
    )
    (place,) = (p for p in home.places() if p.iri.endswith("/2"))
    assert (place.label, place.beliefs) == ("place 2", {v.HERE + "Attic": 1.0})
    assert said(home, place.iri)["here:x"] == "7.0"
    assert check_map(home.engine) == []


def test_the_cell_follows_the_position(home: SemanticMap) -> None:
    home.update(
        "DELETE { ?o here:x ?x } INSERT { ?o here:x 12.5 } WHERE { ?o here:x ?x ; a here:Cup }"
    )
    assert {said(home, o.iri)["here:inCell"][-3:] for o in home.objects()} == {"2_0"}
    assert check_map(home.engine) == []


def test_what_is_deleted_takes_along_what_was_about_it(home: SemanticMap) -> None:
    home.assertions.add("object/1", "category", "bowl", by="ann")
    home.update("DELETE WHERE { <http://m/object/1> ?p ?o }")
    assert [o.iri for o in home.objects()] == ["http://m/object/2"]
    assert home.assertions.all() == ()
    left = home.query('SELECT ?s WHERE { ?s ?p ?o FILTER(CONTAINS(STR(?s), "ation/1")) }')
    assert left.rows == ()
    home.update("DELETE WHERE { <http://m/place/1> ?p ?o }")
    assert home.places() == ()
    assert [o.place for o in home.objects()] == [None]
    assert check_map(home.engine) == []


REFUSED = {
    "INSERT DATA { <http://m/object/1> here:existence 3.0 }": "between 0 and 1",
    "DELETE WHERE { <http://m/object/1> a ?c }": "needs a class",
    "DELETE WHERE { <http://m/place/1> a ?c }": "here:Place",
    "INSERT DATA { <http://m/object/1> here:x 2e0 }": "exactly one here:x",
    "INSERT DATA { <http://m/object/9> a here:Cup ; here:x 2e0 }": "exactly one here:y",
    'INSERT DATA { <http://m/object/9> a here:Cup ; here:x "2" ; here:y 1 }': "here:x",
    "INSERT DATA { <http://m/object/9> a here:Cup ; here:y 1 ; here:x 'NaN'^^xsd:double }": (
        "finite"
    ),
    "INSERT DATA { <http://m/object/1> here:inPlace <http://m/object/2> }": "here:inPlace",
    "INSERT DATA { <http://m/place/1> here:xMin 2e0 }": "here:xMin",
    "DELETE DATA { <http://m/observation/1> sosa:hasFeatureOfInterest <http://m/object/1> }": (
        "feature of interest"
    ),
    "DELETE WHERE { <http://m/object/1> here:x ?x }": "here:x",
    "INSERT DATA { <http://m/object/1> a here:Cub }": "did you mean here:Cup",
    "INSERT DATA { <http://m/object/1> here:exsitence 1.0 }": "did you mean here:existence",
    "INSERT DATA { GRAPH <urn:mine> { <urn:a> here:nonsense 1 } }": "here:nonsense",
    "INSERT DATA { <urn:a> <urn:b> <<( <urn:a> <urn:b> 1 )>> }": "triple terms",
    "DELETE DATA { GRAPH graph:dataset { <http://m/> dct:title 'map' } }": "dct:title",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_badly_made_map_is_refused_and_nothing_is_written(unchanged, text):
    before, sequence = set(unchanged.engine), unchanged.sequence
    with pytest.raises(ShapeError) as refused:
        unchanged.update(text, by="ann")
    assert REFUSED[text] in str(refused.value)
    assert "\n" not in str(refused.value)
    assert (set(unchanged.engine), unchanged.sequence) == (before, sequence)


PROTECTED = {
    "DELETE WHERE { GRAPH graph:ontology { here:Cup ?p ?o } }": "ontology",
    "INSERT DATA { GRAPH graph:commonsense { here:Cup here:isA here:Place } }": "commonsense",
    "INSERT DATA { GRAPH graph:history { <urn:a> <urn:b> 1 } }": "history",
    "INSERT DATA { GRAPH graph:assertions { <urn:a> <urn:b> 1 } }": "use assert",
    "DELETE WHERE { GRAPH graph:dataset { ?s here:sequence ?n } }": "here:sequence",
    "INSERT DATA { GRAPH graph:dataset { <http://m/> here:nextObject 1 } }": "here:nextObject",
    "DELETE WHERE { GRAPH graph:dataset { ?r here:framesApplied ?n } }": "here:framesApplied",
    "CLEAR ALL": "an update may not write",
}


@pytest.mark.parametrize("text", PROTECTED)
def test_what_is_kept_by_other_means_is_refused(unchanged: SemanticMap, text: str) -> None:
    before = set(unchanged.engine)
    with pytest.raises(ProtectedError, match=PROTECTED[text]):
        unchanged.update(text, by="ann")
    assert set(unchanged.engine) == before


def test_a_protected_graph_may_be_written_where_the_caller_allows_it(home: SemanticMap) -> None:
    home.update(
        "INSERT DATA { GRAPH graph:ontology { here:TeaBowl a owl:Class ; rdfs:label 'tea bowl' ; "
        "rdfs:subClassOf here:Object } }",
        allow=("ontology",),
    )
    assert home.catalogue.find("tea bowl").kind == "object"
    home.update("INSERT DATA { <http://m/object/9> a here:TeaBowl ; here:x 1 ; here:y 1 }")
    assert len(home.objects()) == 3


def test_what_was_wrong_before_is_not_held_against_an_update(home: SemanticMap) -> None:
    (quad,) = home.engine.quads_for_pattern(NamedNode("http://m/object/1"), NamedNode(v.Z), None)
    home.engine.remove(quad)  # as an older program may have left it
    assert home.update("INSERT DATA { <http://m/object/1> rdfs:comment 'chipped' }") is not None
    with pytest.raises(ShapeError, match="here:y"):
        home.update("DELETE WHERE { <http://m/object/1> here:y ?y }")


@pytest.mark.parametrize("iri", ["a:b", "tag:x,2026:y", "mailto:ada@example.org", "owl:nothing"])
def test_a_thing_may_have_an_iri_of_any_scheme(home: SemanticMap, iri: str) -> None:
    assert home.update(f'INSERT DATA {{ <{iri}> rdfs:comment "x" }}', by="ada") is not None
    assert said(home, iri)
    with pytest.raises(ShapeError, match="here:x"):
        home.update(f'INSERT DATA {{ <{iri}> a here:Cup ; here:x "2" ; here:y 1 }}', by="ada")


def test_a_blank_node_becomes_an_iri_of_the_map(home: SemanticMap) -> None:
    change = home.update('INSERT DATA { [] rdfs:comment "x" }', by="ada")
    assert change is not None
    (quad,) = [quad for quad in change.added if quad.predicate.value == v.RDFS_COMMENT]
    assert isinstance(quad.subject, NamedNode)
    assert "/.well-known/genid/" in quad.subject.value
    assert quad in set(home.engine.quads_for_pattern(quad.subject, None, None))


def test_the_rdflib_view_writes_through_the_door(home: SemanticMap) -> None:
    sequence = home.sequence
    home.dataset.update("INSERT DATA { <http://m/object/1> rdfs:comment 'chipped' }")
    assert home.sequence == sequence + 1
    with pytest.raises(ShapeError):
        home.dataset.update("INSERT DATA { <http://m/object/1> here:x 7e0 }")
    triple = (rdflib.URIRef("urn:a"), rdflib.URIRef("urn:b"), rdflib.Literal(1))
    before = set(home.engine)
    for write in (
        lambda: home.dataset.graph(rdflib.URIRef(v.MAP_GRAPH.value)).add(triple),
        lambda: home.dataset.graph(rdflib.URIRef(v.MAP_GRAPH.value)).remove((None, None, None)),
        lambda: home.dataset.addN([(*triple, home.dataset.default_graph)]),
        lambda: home.dataset.remove_graph(rdflib.URIRef(v.MAP_GRAPH.value)),
    ):
        with pytest.raises(ProtectedError, match=r"SemanticMap\.update"):
            write()
    assert set(home.engine) == before


THINGS = st.sampled_from(["object/1", "object/2", "object/9", "place/1", "observation/1"])
FACTS = st.sampled_from(
    [
        *("a here:Cup", "a here:Bowl", "a here:Kitchen", "a sosa:Observation", "here:x 1.0"),
        *("here:y 2", "here:z 'high'", "here:existence 2.0", "here:existence 0.5"),
        *("here:inPlace <http://m/place/1>", "here:inPlace <http://m/object/1>"),
        *("here:confidence 0.0", "here:observationCount 0", "here:xMin 9", "rdfs:label 'it'"),
        *("here:firstSeen '2030-01-01T00:00:00Z'^^xsd:dateTime", "here:score 7.0"),
        *("here:explainedBy <http://m/observation/1>", "here:hasBelief <http://m/place/1>"),
    ]
)
INSERTS = st.builds("INSERT DATA {{ <http://m/{}> {} }}".format, THINGS, FACTS)
PATTERNS = st.sampled_from(["a ?o", "?p ?o", "here:x ?o", "here:inPlace ?o", "here:explainedBy ?o"])
DELETES = st.builds("DELETE WHERE {{ <http://m/{}> {} }}".format, THINGS, PATTERNS)


@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.lists(st.one_of(INSERTS, DELETES), min_size=1, max_size=3).map(" ; ".join))
def test_the_door_lets_in_just_what_the_whole_map_passes_with(text: str) -> None:
    with in_memory_map(base=BASE) as home:
        fill(home)
        try:
            home.update(text)
            refused = False
        except ShapeError:
            refused = True
        if not refused:
            assert check_map(home.engine) == []
            return
        bare = Store()
        bare.extend(home.engine)
        pending = ChangeDraft(home.store)
        pending.apply(evaluate_update(home.store, text))
        for quad in pending.removed:
            bare.remove(quad)
        bare.extend(pending.added)
        assert check_map(bare) != []


EVERYTHING = "DELETE WHERE { ?s ?p ?o }"


def fill_guarded(made: SemanticMap, objects: int, places: int = 1) -> None:
    records = tuple(thing(made) for _ in range(objects))
    rooms = tuple(
        PlaceRecord(f"{BASE}place/{n}", f"place {n}", n, n + 1, 0, 5, 1) for n in range(places)
    )
    made.apply(MapUpdate(objects=records, places=rooms))


@pytest.fixture
def many() -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as made:
        fill_guarded(made, 30, 2)
        yield made


def delete_objects(least: int, most: int) -> str:
    names = " ".join(f"<object/{n}>" for n in range(least, most + 1))
    return (
        f"DELETE {{ ?s ?p ?o }} WHERE {{ VALUES ?s {{ {names} }} GRAPH graph:map {{ ?s ?p ?o }} }}"
    )


def test_an_update_that_empties_the_map_is_refused_and_says_what_would_have_worked(many):
    before, sequence = set(many.engine), many.sequence
    assert many.update("DELETE WHERE { <http://m/object/99> ?p ?o }") is None
    with pytest.raises(UnconfirmedDeletionError) as refusal:
        many.update(EVERYTHING, by="ann")
    assert "32 of 32 objects and places" in str(refusal.value)
    assert "--yes" in str(refusal.value) and "Here-Confirm: delete" in str(refusal.value)
    assert (set(many.engine), many.sequence) == (before, sequence)


def test_ten_things_go_without_a_question_and_eleven_of_thirty_do_not(many: SemanticMap) -> None:
    many.update(delete_objects(1, 10))
    assert len(many.objects()) == 20
    with pytest.raises(UnconfirmedDeletionError, match="11 of 22 objects and places"):
        many.update(delete_objects(11, 21))
    many.update(EVERYTHING, by="ann", confirmed=True)
    assert not many.objects() and not many.places()


@pytest.mark.parametrize(("objects", "deleted"), [(150, 15), (9, 9)])
def test_a_small_share_and_a_small_map_go_without_a_question(objects: int, deleted: int) -> None:
    with in_memory_map(base=BASE) as large:
        fill_guarded(large, objects)
        large.update(delete_objects(1, deleted))
        assert len(large.objects()) == objects - deleted


def test_what_loses_its_type_and_what_is_replaced_count_by_their_result(many: SemanticMap) -> None:
    with pytest.raises(UnconfirmedDeletionError):
        many.update("DELETE { ?s a ?t } WHERE { GRAPH graph:map { ?s a ?t ; here:x ?x } }")
    cup, bowl = f"<{many.catalogue.find('cup').iri}>", f"<{v.HERE}Bowl>"
    many.update(
        f"DELETE {{ ?s a {cup} }} INSERT {{ ?s a {bowl} }} WHERE {{ ?s a {cup} }}", by="ann"
    )
    assert {record.category for record in many.objects()} == {v.HERE + "Bowl"}
    with pytest.raises(UnconfirmedDeletionError):
        many.dataset.update(EVERYTHING)


def test_the_limit_can_be_set(many: SemanticMap) -> None:
    many.deletion_limit = DeletionLimit(share=1.0)
    many.update(EVERYTHING)
    fill_guarded(many, 3)
    many.deletion_limit = DeletionLimit(share=0.0, count=1)
    with pytest.raises(UnconfirmedDeletionError):
        many.update(delete_objects(31, 32))
