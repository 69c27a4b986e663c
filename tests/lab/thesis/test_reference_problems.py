"""The benchmark's search problems in the thesis' building agree with what the graph derives."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lab.thesis.table_4_5 import reference_world
from planner.search.goals.search_goals import derive_goals
from planner.search.plans.thesis_rules import Travel, distances

Shared = Callable[[str], Path]


@pytest.fixture
def problems(shared: Shared) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(shared("data/search/problems_reference.json").read_text())
    return loaded


def test_the_graph_derives_the_places_that_the_problems_list(problems: dict[str, Any]) -> None:
    listed = {query["object"]: query["listed"] for query in problems["queries"]}
    with reference_world() as world:
        derived = {
            label: sorted(int(goal.iri.rsplit("/", 1)[1]) for goal in derive_goals(world, label))
            for label in listed
        }
    assert len(listed) > 18
    assert derived == {label: sorted(places) for label, places in listed.items()}


def test_travel_costs_what_the_problems_say(problems: dict[str, Any]) -> None:
    (world,) = problems["worlds"]
    travel = Travel()
    assert (travel.speed, travel.explore) == (world["speed"], world["places"][0]["explore_s"])
    centres = [place["centre"] for place in world["places"]]
    for query in problems["queries"]:
        metres = distances(query["start"], centres)
        assert metres / travel.speed == pytest.approx(query["t0"], abs=0.01)
