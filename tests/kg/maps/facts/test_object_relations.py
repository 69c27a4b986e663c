"""Relations of objects are facts of the map, which people can overrule."""

from dataclasses import replace

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError, ProtectedError, ShapeError
from kg.model.records import MapUpdate, Relation
from kg.model.transactions import ChangeSet
from kg.serving.client.update_codec import update_from_json, update_to_json
from kg.serving.opening import in_memory_map
from tests.kg.conftest import thing

BASE = "http://example.org/lab/"
CUP, TABLE, DESK, BOWL = (f"{BASE}object/{number}" for number in (1, 2, 3, 4))


@pytest.fixture
def chart() -> SemanticMap:
    semantic_map = in_memory_map(base=BASE)
    named = {CUP: "cup", TABLE: "dining table", BOWL: "bowl", DESK: "dining table"}
    records = [thing(semantic_map, label, iri=iri) for iri, label in named.items()]
    semantic_map.apply(MapUpdate(objects=tuple(records)))
    return semantic_map


def write(semantic_map: SemanticMap, *relations: Relation, iri: str = CUP) -> ChangeSet | None:
    (record,) = semantic_map.perceived.objects((iri,))
    return semantic_map.apply(MapUpdate(objects=(replace(record, relations=relations),)))


def stated(semantic_map: SemanticMap) -> set[tuple[str, str, str]]:
    rows = semantic_map.query(
        "SELECT ?a ?r ?b WHERE { VALUES ?r { here:on here:inside here:beside } ?a ?r ?b }"
    ).rows
    return {tuple(str(term).rpartition("/")[2].rpartition("#")[2] for term in row) for row in rows}


def nodes(semantic_map: SemanticMap) -> int:
    return len(semantic_map.query("SELECT ?n WHERE { ?n a here:SpatialRelation }").rows)


def test_what_is_probable_is_a_triple_and_every_relation_a_node(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8), Relation("beside", BOWL, 0.3))
    assert stated(chart) == {("1", "on", "2")}
    assert nodes(chart) == 2
    assert chart.perceived.objects((CUP,))[0].relations == (
        Relation("beside", BOWL, 0.3),
        Relation("on", TABLE, 0.8),
    )


def test_only_what_changes_is_written(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8))
    assert write(chart, Relation("on", TABLE, 0.8)) is None
    assert len(write(chart, Relation("on", TABLE, 0.7)) or ()) == 2
    assert len(write(chart, Relation("on", TABLE, 0.4)) or ()) == 3  # no triple any more
    assert len(write(chart) or ()) == 5
    assert nodes(chart) == 0


def test_a_record_that_does_not_say_leaves_relations_as_they_are(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8))
    record = replace(chart.objects()[0], relations=None, observations=2)
    assert len(chart.apply(MapUpdate(objects=(record,)))) == 2
    assert stated(chart) == {("1", "on", "2")}


def test_a_removed_support_leaves_nothing_behind(chart: SemanticMap) -> None:
    before = set(chart.engine)
    write(chart, Relation("on", TABLE, 0.8))
    chart.apply(MapUpdate(removed=(TABLE,)))
    assert stated(chart) == set()
    assert not {q for q in set(chart.engine) - before if "sequence" not in str(q.predicate)}


def test_impossible_relations_are_refused(chart: SemanticMap) -> None:
    on_table = Relation("on", TABLE, 0.8)
    wrong = (Relation("on", CUP, 0.8), replace(on_table, probability=1.2), Relation("on", "no", 1))
    for relations in (*((one,) for one in wrong), (on_table, on_table)):
        with pytest.raises(InvalidFactError):
            write(chart, *relations)


def test_an_assertion_outranks_the_mapper_until_it_is_retracted(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8))
    chart.assertions.add(CUP, "on", "object/3", by="ann")
    write(chart, Relation("on", TABLE, 0.9))
    assert stated(chart) == {("1", "on", "3")}
    (assertion,) = chart.assertions.conflicts()
    assert (assertion.perceived, assertion.strength) == (TABLE, 0.9)
    chart.assertions.retract(CUP, "on")
    assert stated(chart) == {("1", "on", "2")}
    assert chart.objects()[0].relations == (Relation("on", TABLE, 0.9),)


def test_an_assertion_names_another_object(chart: SemanticMap) -> None:
    for other in ("object/1", "object/99", "the table", ""):
        with pytest.raises(InvalidFactError):
            chart.assertions.add(CUP, "on", other, by="ann")


def test_an_assertion_goes_with_the_object_it_names(chart: SemanticMap) -> None:
    chart.assertions.add(CUP, "on", "object/3", by="ann")
    (record,) = chart.perceived.objects((CUP,))
    chart.apply(MapUpdate(objects=(replace(record, observations=5),), removed=(DESK,)))
    assert stated(chart) == set()
    assert chart.assertions.all() == ()


def test_sparql_insert_becomes_an_assertion(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8))
    chart.update(
        "DELETE DATA { <object/1> here:on <object/2> } ; "
        "INSERT DATA { <object/1> here:on <object/3> }",
        by="ann",
    )
    (assertion,) = chart.assertions.all()
    assert (assertion.property, assertion.value, assertion.perceived) == ("on", DESK, TABLE)
    write(chart, Relation("on", TABLE, 0.8))
    assert stated(chart) == {("1", "on", "3")}
    assert nodes(chart) == 1


def test_sparql_delete_asserts_nothing_and_then_gives_back(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8))
    chart.update("DELETE DATA { <object/1> here:on <object/2> }", by="ann")
    write(chart, Relation("on", TABLE, 0.8))
    assert stated(chart) == set()
    chart.update("INSERT DATA { <object/1> here:on <object/3> }", by="ann")
    chart.update("DELETE DATA { <object/1> here:on <object/3> }", by="ann")
    assert stated(chart) == {("1", "on", "2")}
    assert chart.assertions.all() == ()


def test_deleting_a_support_by_sparql_asserts_nothing(chart: SemanticMap) -> None:
    write(chart, Relation("on", TABLE, 0.8))
    chart.update("DELETE WHERE { <object/2> ?p ?o }", by="ann")
    assert (stated(chart), nodes(chart), chart.assertions.all()) == (set(), 0, ())


def test_computed_relations_cannot_be_written(chart: SemanticMap) -> None:
    write(chart, Relation("beside", BOWL, 0.8))
    write(chart, Relation("beside", CUP, 0.8), iri=BOWL)
    with pytest.raises(ProtectedError, match="computed"):
        chart.update("INSERT DATA { <object/1> here:beside <object/2> }", by="ann")
    with pytest.raises(ProtectedError, match="computed"):
        chart.update("DELETE DATA { <object/1> here:beside <object/4> }", by="ann")
    with pytest.raises(ProtectedError, match="computed"):
        chart.update(
            "INSERT DATA { <object/1/relation/beside/4> here:relationProbability 0.1e0 }", by="ann"
        )


def test_relations_point_at_objects(chart: SemanticMap) -> None:
    with pytest.raises(ShapeError, match="here:on must be at most one object"):
        chart.update("INSERT DATA { <object/1> here:on <place/1> }", by="ann")


def test_relations_survive_the_way_to_a_served_map(chart: SemanticMap) -> None:
    (record,) = chart.perceived.objects((CUP,))
    update = MapUpdate(objects=(replace(record, relations=(Relation("on", TABLE, 0.8),)),))
    (back,) = update_from_json(update_to_json(update)).objects
    assert back.relations == (Relation("on", TABLE, 0.8),)
    (silent,) = update_from_json(update_to_json(MapUpdate(objects=(record,)))).objects
    assert silent.relations == ()
    data = update_to_json(update)
    data["objects"][0]["relations"][0]["kind"] = "under"
    with pytest.raises(InvalidFactError, match="on or inside or beside"):
        update_from_json(data)
