"""`hereabouts.find`: what the map knows, where to look, and inputs that are none."""

import math
import re
from typing import Any

import pytest

import hereabouts
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError
from kg.serving.opening import in_memory_map
from planner.search.goals.known_objects import map_time
from planner.search.plans.search_state import build_search
from tests.planner.flat import fill

START = (6.0, 1.0)


@pytest.fixture(scope="module")
def flat() -> SemanticMap:
    return fill(in_memory_map(title="flat"))


def test_printed_it_says_what_is_known_and_the_first_looks(flat: SemanticMap) -> None:
    answer = hereabouts.find(flat, "cup", start=START, now=map_time(flat))
    known, *looks, chances = str(answer).splitlines()
    assert known == answer.lines[0] and "cup 2 was seen there" in known
    assert looks[0].startswith("1. From (") and "cup 2" in looks[0]
    assert re.search(r"[Tt]h(is look finds|ese looks find) it with ", chances)
    assert answer.plan is not None and answer.plan.steps[0].why[0].candidate.kind == "known"


def test_a_heading_may_be_left_out_and_several_things_are_wanted(flat: SemanticMap) -> None:
    one, other = (hereabouts.find(flat, "cup", "bed", start=at) for at in (START, (*START, 0.0)))
    assert str(one) == str(other)
    assert one.plan is not None and one.plan.targets == ("cup", "bed")


def test_what_no_detector_sees_has_an_answer_and_no_plan(flat: SemanticMap) -> None:
    answer = hereabouts.find(flat, "keys")
    assert answer.plan is None and str(answer).startswith("No detector here can see")


def test_a_map_without_floor_says_why_there_is_no_plan() -> None:
    with in_memory_map() as empty:
        answer = hereabouts.find(empty, "cup")
    assert answer.plan is None and str(answer).startswith("nowhere to search for cup")


@pytest.mark.parametrize(
    ("wanted", "options", "says"),
    [
        ((), {}, "what to look for"),
        (("",), {}, "what to look for"),
        (("cup",), {"start": (1.0,)}, "x, y"),
        (("cup",), {"start": (1.0, math.nan)}, "x, y"),
        (("cup",), {"start": (1, 2, 3, 4)}, "x, y"),
        (("cup",), {"start": 5}, "x, y"),
        (("cup",), {"start": ("here", "there")}, "x, y"),
        (("cup",), {"start": (4000.0, 2000.0)}, "millimetres"),
        (("cup",), {"now": math.inf}, "seconds since 1970"),
    ],
)
def test_inputs_that_are_none_are_refused(flat, wanted, options, says):
    with pytest.raises(QueryParameterError, match=says):
        hereabouts.find(flat, *wanted, **options)


def test_an_unknown_word_is_refused(flat: SemanticMap) -> None:
    with pytest.raises(UnknownCategoryError):
        hereabouts.find(flat, "unicorn")


def test_a_planning_state_is_told_the_name_of_its_function(flat: SemanticMap) -> None:
    state: Any = build_search(flat, ["cup"])
    with pytest.raises(TypeError, match="plan_views"):
        hereabouts.find(state, "cup")
