"""Objects by what they are, where they are, and what they are near; places by belief."""

import math
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.maps.query.evaluation import Table
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, QueryError, QueryParameterError, UnknownCategoryError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map, open_map
from kg.serving.publishing import PublishTarget, snapshot_of

BASE = "https://example.org/flat/"
WHERE = {"banana": (1.0, 1.0), "apple": (1.5, 1.0), "cup": (4.0, 1.0), "chair": (7.0, 7.0)}


def object_at(m: SemanticMap, number: int, label: str, x: float, y: float) -> ObjectRecord:
    return ObjectRecord(
        f"{BASE}object/{number}",
        m.catalogue.find(label, "object").iri,
        np.array([x, y, 0.5]),
        confidence=1.0,
        existence=0.5,
        observations=1,
        first_seen=0.0,
        last_seen=0.0,
        place=f"{BASE}place/{1 if x < 5 else 2}",
    )


@pytest.fixture(scope="module")
def flat() -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as m:
        kitchen, office = (m.catalogue.find(label, "place").iri for label in ("kitchen", "office"))
        places = (
            PlaceRecord(f"{BASE}place/1", "place 1", 0, 5, 0, 9, 3, {kitchen: 0.8, office: 0.2}),
            PlaceRecord(f"{BASE}place/2", "place 2", 5, 9, 0, 9, 3, {kitchen: 0.3, office: 0.7}),
            PlaceRecord(f"{BASE}place/3", "place 3", 9, 12, 0, 9),
        )
        objects = tuple(
            object_at(m, n, label, *WHERE[label]) for n, label in enumerate(sorted(WHERE), start=1)
        )
        m.apply(MapUpdate(objects=objects, places=places))
        yield m


def labels(m: SemanticMap, **conditions: object) -> list[str]:
    return [m.catalogue.label(o.category) for o in m.objects(**conditions)]  # type: ignore[arg-type]


def test_a_category_includes_what_is_below_it(flat: SemanticMap) -> None:
    assert labels(flat, category="food") == ["apple", "banana"]
    assert labels(flat, category="chair") == ["chair"]
    with pytest.raises(UnknownCategoryError, match="did you mean banana"):
        flat.objects("bananna")


def test_a_place_goes_by_number_label_or_iri(flat: SemanticMap) -> None:
    for place in (1, "1", "place 1", f"{BASE}place/1"):
        assert labels(flat, place=place) == ["apple", "banana", "cup"]
    with pytest.raises(QueryParameterError, match=r"there are: place 1 \(kitchen\), place 2"):
        flat.objects(place="cellar")


def test_what_is_near_comes_nearest_first(flat: SemanticMap) -> None:
    assert labels(flat, near=(1.0, 1.0), radius=3.0) == ["banana", "apple", "cup"]
    assert labels(flat, near=np.array([1.0, 1.0]), radius=2.9) == ["banana", "apple"]
    (banana,) = flat.objects("banana")
    assert labels(flat, near=banana.p_map, radius=2.9) == ["banana", "apple"]
    for name in (banana.iri, "banana", banana.iri.removeprefix(BASE)):
        assert labels(flat, near=name, radius=3.0) == ["apple", "cup"]


def test_conditions_add_up(flat: SemanticMap) -> None:
    assert labels(flat, category="food", near=(4.0, 1.0), radius=2.6) == ["apple"]
    assert labels(flat, category="chair", place=1) == []


def test_near_what_is_not_there_is_refused(flat: SemanticMap) -> None:
    with pytest.raises(QueryParameterError, match="no object"):
        flat.objects(near=f"{BASE}object/99")
    with pytest.raises(QueryParameterError, match="finite"):
        flat.objects(near=(math.nan, 0.0))


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(-3, 12), y=st.floats(-3, 12), radius=st.one_of(st.floats(0, 20), st.floats(20, 1e9))
)
def test_cells_change_no_answer(flat: SemanticMap, x: float, y: float, radius: float) -> None:
    expected = {
        o.iri for o in flat.objects() if math.hypot(o.p_map[0] - x, o.p_map[1] - y) <= radius
    }
    assert {o.iri for o in flat.objects(near=(x, y), radius=radius)} == expected


def test_places_by_their_likeliest_category_or_by_belief(flat: SemanticMap) -> None:
    def found(*given: object, **conditions: object) -> list[str]:
        return [place.label for place in flat.places(*given, **conditions)]  # type: ignore[arg-type]

    assert found() == ["place 1", "place 2", "place 3"]
    assert found("kitchen") == ["place 1"]
    assert found("kitchen", min_belief=0.25) == ["place 1", "place 2"]
    assert found(min_belief=0.75) == ["place 1"]


def test_query_takes_a_name_a_text_or_a_file(flat: SemanticMap, tmp_path: object) -> None:
    by_name = flat.query("objects-by-category", category="food")
    assert by_name.to_columns()["category"] == ["apple", "banana"]
    by_text = flat.query("SELECT ?x { ?o a here:Cup ; here:x ?x }")
    assert by_text.to_columns() == {"x": [4.0]}
    assert flat.query("ASK{?o a here:Cup}").rows == ((True,),)
    with pytest.raises(QueryError, match="no query 'objekts'; did you mean objects"):
        flat.query("objekts")


def test_network_says_who_is_in_what_and_near_whom(flat: SemanticMap) -> None:
    graph = flat.network(near=1.0)
    edges = {
        (graph.nodes[a]["label"], d["relation"], graph.nodes[b]["label"])
        for a, b, d in graph.edges(data=True)
        if d["relation"] == "near"
    }
    assert edges in ({("apple", "near", "banana")}, {("banana", "near", "apple")})
    assert set(graph.neighbors(f"{BASE}place/2")) == {o.iri for o in flat.objects("chair")}
    assert graph.nodes[f"{BASE}place/3"]["label"] == "place 3"


@settings(max_examples=25, deadline=None)
@given(
    near=st.floats(0.1, 5.0),
    points=st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=12),
)
def test_near_edges_are_all_pairs_within_reach(flat, near, points):
    from kg.maps.networkx_graph import network

    objects = [object_at(flat, n, "cup", x, y) for n, (x, y) in enumerate(points)]
    graph = network(objects, (), flat.catalogue, near)
    expected = {
        frozenset((a.iri, b.iri))
        for a in objects
        for b in objects
        if a.iri < b.iri and math.dist(a.p_map[:2], b.p_map[:2]) <= near
    }
    assert {frozenset(edge) for edge in graph.edges} == expected


@pytest.fixture
def changing() -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as m:
        m.apply(MapUpdate(objects=(object_at(m, 1, "cup", 1.0, 1.0),)))
        yield m


def test_a_snapshot_stays_as_it_was(changing: SemanticMap) -> None:
    with changing.snapshot() as before:
        changing.apply(MapUpdate(objects=(object_at(changing, 2, "cup", 2.0, 1.0),)))
        assert (len(before.objects()), len(changing.objects())) == (1, 2)
        assert (before.base, before.sequence) == (BASE, 1)
        with pytest.raises(GraphError, match="reading only"):
            before.apply(MapUpdate(removed=(f"{BASE}object/1",)))


class Heard:
    """Collects what a subscription reports, and waits for it."""

    def __init__(self) -> None:
        self.told: list[tuple[list[object], list[object]]] = []
        self._news = threading.Semaphore(0)

    def __call__(self, added: Table, removed: Table) -> None:
        self.told.append((added.to_columns()["x"], removed.to_columns()["x"]))  # type: ignore[arg-type]
        self._news.release()

    def wait(self) -> tuple[list[object], list[object]]:
        assert self._news.acquire(timeout=120)
        return self.told[-1]


CUPS = "SELECT ?x { ?o a here:Cup ; here:x ?x }"


def test_a_standing_question_tells_what_came_and_went(changing: SemanticMap) -> None:
    heard = Heard()
    stop = changing.subscriptions.on(CUPS, heard)
    changing.apply(MapUpdate(objects=(object_at(changing, 2, "cup", 2.0, 1.0),)))
    assert heard.wait() == ([2.0], [])
    changing.apply(MapUpdate(objects=(object_at(changing, 1, "cup", 3.0, 1.0),)))
    assert heard.wait() == ([3.0], [1.0])
    changing.apply(MapUpdate(objects=(object_at(changing, 3, "chair", 3.0, 1.0),)))
    changing.apply(MapUpdate(removed=(f"{BASE}object/2",)))
    assert heard.wait() == ([], [2.0])
    stop()
    stop()
    changing.apply(MapUpdate(removed=(f"{BASE}object/1",)))
    assert len(heard.told) == 3


def test_closing_the_map_ends_its_standing_questions() -> None:
    heard = Heard()
    with in_memory_map(base=BASE) as m:
        m.subscriptions.on(CUPS, heard)
        m.apply(MapUpdate(objects=(object_at(m, 1, "cup", 1.0, 1.0),)))
        heard.wait()
        running = [t for t in threading.enumerate() if t.name == "subscription"]
    assert running
    assert not any(thread.is_alive() for thread in running)


def test_on_a_server_the_commits_of_others_are_noticed(sparql_server: str) -> None:
    heard = Heard()
    with (
        in_memory_map(base=BASE) as writer,
        closing(PublishTarget(sparql_server)) as target,
        ExitStack() as opened,
    ):
        target.synchronise(BASE, snapshot_of(writer))
        reader = opened.enter_context(open_map(sparql_server, read_only=True))
        reader.subscriptions.on(CUPS, heard)
        change = writer.apply(MapUpdate(objects=(object_at(writer, 1, "cup", 1.0, 1.0),)))
        target.apply(BASE, change, 0)
        assert heard.wait() == ([1.0], [])
        assert [o.p_map[0] for o in reader.objects("cup", near=(0.0, 0.0), radius=3)] == [1.0]
        with reader.snapshot() as copy:
            assert len(copy.objects()) == 1


def test_objects_by_existence_are_those_of_the_query(flat: SemanticMap) -> None:
    doubtful = replace(object_at(flat, 1, "cup", 2.0, 2.0), iri=f"{BASE}object/9", existence=0.2)
    with in_memory_map(base=BASE) as m:
        m.apply(MapUpdate(objects=(*flat.objects(), doubtful)))
        assert doubtful.iri in {one.iri for one in m.objects()}
        listed = {one.iri for one in m.objects(min_existence=0.5)}
        assert listed == {row["object"] for row in m.query("objects").records()}
        assert listed == {one.iri for one in flat.objects()}
