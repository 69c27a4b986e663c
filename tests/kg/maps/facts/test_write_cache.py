"""A writer that remembers what it wrote writes what a writer that looks each time would."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.write_cache import WriteCache
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import HereaboutsError
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord
from kg.model.transactions import Cause
from kg.serving.opening import in_memory_map

BASE = "https://example.org/twin/"
TIMES = {v.PROV_GENERATED_AT, v.CONFLICT_SINCE}
SHOWN = {v.MAP_GRAPH.value, v.ASSERTIONS_GRAPH.value}

Step = Callable[[SemanticMap, int], object]


@pytest.fixture(scope="module")
def twins() -> tuple[SemanticMap, SemanticMap]:
    return in_memory_map(base=BASE), in_memory_map(base=BASE)


def thing(number: int, x: float, seen: int, category: str) -> ObjectRecord:
    box = (1.0, 2.0, 3.0 + seen, 4.0)
    return ObjectRecord(
        iri=f"{BASE}object/{number}",
        category=v.HERE + category,
        p_map=np.array([x, 1.0, 0.5]),
        confidence=1.0,
        existence=0.5,
        observations=seen,
        first_seen=10.0,
        last_seen=10.0 + seen,
        place=f"{BASE}place/1",
        evidence=Evidence(f"frame-{seen}", "tour", 10.0 + seen, box, 0.8, "net"),
    )


def frame(which: frozenset[int], x: float, seen: int, category: str, belief: float) -> Step:
    def run(chart: SemanticMap, first: int) -> object:
        objects = tuple(thing(first + k, x + k, seen, category) for k in sorted(which))
        beliefs = {v.HERE + "Kitchen": belief, v.HERE + "Office": 1 - belief}
        room = PlaceRecord(f"{BASE}place/1", "place 1", 0, 9, 0, 9, seen, beliefs)
        return chart.apply(MapUpdate(objects=objects, places=(room,)))

    return run


def on(number: int, act: Callable[[SemanticMap, str], object]) -> Step:
    return lambda chart, first: act(chart, f"{BASE}object/{first + number}")


def edit(text: str) -> Callable[[SemanticMap, str], object]:
    return lambda chart, iri: chart.update(text.replace("?o", f"<{iri}>"), by="ann")


def unheard(chart: SemanticMap, iri: str) -> object:
    """A commit beside the writer, as another module makes it."""
    quads = tuple(chart.engine.quads_for_pattern(None, None, None, None))
    about = sorted((q for q in quads if getattr(q.subject, "value", "") == iri), key=str)
    return chart.store.commit(about[:3], [], Cause("import"))


NUMBER = st.integers(0, 2)
STEPS = st.one_of(
    st.builds(
        frame,
        st.frozensets(NUMBER, min_size=1),
        st.sampled_from([1.0, 1.5, 6.0]),
        st.integers(1, 4),
        st.sampled_from(["Chair", "Table"]),
        st.sampled_from([0.2, 0.9]),
    ),
    st.builds(
        on,
        NUMBER,
        st.sampled_from(
            [
                edit("DELETE WHERE { GRAPH graph:map { ?o ?p ?v } }"),
                edit(
                    "DELETE { GRAPH graph:map { ?o here:x ?x } } "
                    "INSERT { GRAPH graph:map { ?o here:x 7e0 } } "
                    "WHERE { GRAPH graph:map { ?o here:x ?x } }"
                ),
                edit("INSERT DATA { GRAPH graph:map { ?o rdfs:comment 'mine' } }"),
                edit(
                    "DELETE { GRAPH graph:map { ?o rdfs:label ?l } } "
                    "INSERT { GRAPH graph:map { ?o rdfs:label 'throne' } } "
                    "WHERE { GRAPH graph:map { ?o rdfs:label ?l } }"
                ),
                lambda chart, iri: chart.apply(MapUpdate(removed=(iri,))),
                lambda chart, iri: chart.assertions.add(
                    iri, "category", v.HERE + "Table", by="bob"
                ),
                lambda chart, iri: chart.assertions.add(iri, "position", (3, 3, 1), by="bob"),
                lambda chart, iri: chart.assertions.retract(iri, "category", by="bob"),
                lambda chart, iri: chart.assertions.retract(iri, "position", by="bob"),
                unheard,
            ]
        ),
    ),
)


def shown(chart: SemanticMap) -> set[Quad]:
    return {
        quad
        for quad in chart.engine
        if getattr(quad.graph_name, "value", "") in SHOWN and quad.predicate.value not in TIMES
    }


def outcome(step: Step, chart: SemanticMap, first: int) -> object:
    try:
        step(chart, first)
    except HereaboutsError as error:
        return type(error), str(error)
    return None


@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(steps=st.lists(STEPS, min_size=2, max_size=10))
def test_what_is_remembered_makes_no_difference(twins, steps):
    remembering, looking = twins
    first = 10 * (remembering.sequence + 1)  # objects that no example had before
    for step in steps:
        # the other writer begins with nothing at hand each time
        frames = looking._writer
        frames._recent = WriteCache(looking.store, frames._owns)
        assert outcome(step, remembering, first) == outcome(step, looking, first)
        assert shown(remembering) == shown(looking)


def test_a_change_set_holds_nothing_that_changes_nothing(twins):
    chart = twins[0]
    before = set(chart.engine)
    change = chart._writer.change(MapUpdate(objects=(thing(5, 2.0, 9, "Chair"),)), Cause("frame"))
    assert change is not None
    assert not before & set(change.added)
    assert before >= set(change.removed)


def test_what_others_write_of_a_subject_is_not_the_writers() -> None:
    with in_memory_map(base=BASE) as chart:
        it, own = NamedNode(f"{BASE}object/1"), NamedNode(f"{BASE}own")
        mine, theirs = (
            Quad(it, predicate, Literal("it"), v.MAP_GRAPH)
            for predicate in (own, NamedNode(f"{BASE}theirs"))
        )
        cache = WriteCache(chart.store, lambda quad: quad.predicate == own)
        cache.catch_up()
        assert not cache.of(it)
        change = chart.store.commit([], [mine, theirs], Cause("import"))
        assert change is not None
        cache.note(change)
        fresh = WriteCache(chart.store, lambda quad: quad.predicate == own)
        assert list(cache.of(it)) == list(fresh.of(it)) == [mine]
