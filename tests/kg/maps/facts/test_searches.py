"""Searches of robots as facts: they come back with their looks and obstacles."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import LookRecord, MapUpdate, ObstacleRecord, SearchRecord

BASE = "https://example.org/map/"
CUP, APPLE = v.HERE + "Cup", v.HERE + "Apple"
SEARCH = SearchRecord(
    iri=f"{BASE}search/1",
    words=("apple", "something to drink from"),
    categories=(APPLE, CUP),
    state="found",
    started=1e9,
    ended=1e9 + 60,
    seconds=58.5,
    left=0.25,
    found=(f"{BASE}object/3",),
)
LOOK = LookRecord(
    iri=f"{BASE}search/1/look/1",
    search=SEARCH.iri,
    number=1,
    stamp=1e9 + 5,
    position=(1.25, -2.5),
    heading=0.5,
    extent=1.0123,
    categories=(APPLE, CUP),
    found=(f"{BASE}object/3",),
    glimpses=((1.0, -2.0, 0.25), (1.25, -2.25, 0.5)),
)
OBSTACLE = ObstacleRecord(
    f"{BASE}search/1/obstacle/1", SEARCH.iri, 1, 1e9 + 7, (3.5, 0.75), "a closed door"
)


def test_a_search_comes_back_as_it_was(semantic_map: SemanticMap) -> None:
    second = replace(LOOK, iri=f"{SEARCH.iri}/look/2", number=2, found=(), glimpses=())
    semantic_map.apply(MapUpdate(search=SEARCH, looks=(second, LOOK), obstacles=(OBSTACLE,)))
    searches = semantic_map.searches
    assert searches.all() == (SEARCH,)
    assert searches.looks(SEARCH.iri) == (LOOK, second)
    assert searches.obstacles(SEARCH.iri) == (OBSTACLE,)
    assert searches.looks(f"{BASE}search/2") == searches.obstacles(f"{BASE}search/2") == ()
    assert check_map(semantic_map.engine) == []


def test_the_state_of_a_search_replaces_its_last_one(semantic_map: SemanticMap) -> None:
    running = replace(SEARCH, state="running", ended=None, left=1.0, found=())
    other = replace(running, iri=f"{BASE}search/10")
    for search in (other, running, SEARCH):
        semantic_map.apply(MapUpdate(search=search))
    assert semantic_map.searches.all() == (SEARCH, other)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (MapUpdate(search=replace(SEARCH, left=1.01)), "left"),
        (MapUpdate(search=replace(SEARCH, left=-0.01)), "left"),
        (MapUpdate(search=replace(SEARCH, words=())), "needs .*words and"),
        (MapUpdate(search=replace(SEARCH, categories=())), "needs .*words and"),
        (MapUpdate(search=replace(SEARCH, state="lost")), "running, stopped, found"),  # type: ignore[arg-type]
        (MapUpdate(looks=(replace(LOOK, glimpses=((0.0, math.nan, 0.0),)),)), "glimpses"),
        (MapUpdate(looks=(replace(LOOK, position=(math.inf, 0.0)),)), "position"),
    ],
)
def test_a_search_that_cannot_be_is_refused(
    semantic_map: SemanticMap, wrong: MapUpdate, message: str
) -> None:
    before = semantic_map.sequence
    with pytest.raises(InvalidFactError, match=message):
        semantic_map.apply(wrong)
    assert semantic_map.sequence == before
