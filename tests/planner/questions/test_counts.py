"""Counts in words: things without a name stand beside the objects, by place."""

from __future__ import annotations

import numpy as np
import pytest

from kg.serving.opening import in_memory_map
from planner.questions.answers import answer_question
from planner.questions.counts import counted_unnamed, sized
from tests.planner.flat import fill, with_unnamed


def test_they_are_counted_by_place() -> None:
    with in_memory_map() as flat:
        assert counted_unnamed(fill(flat)) == ""
    with in_memory_map() as flat:
        with_unnamed(flat)
        told = "3 things without a name (2 in place 1, 1 in place 3)"
        assert counted_unnamed(flat) == told
        assert counted_unnamed(flat, flat.place_iri(1)) == "2 things without a name"
        assert counted_unnamed(flat, flat.place_iri(2)) == ""


@pytest.mark.parametrize(
    ("question", "line"),
    [
        (
            "what is in the kitchen?",
            "2 objects in the kitchen: a banana, a cup, and 2 things without a name",
        ),
        ("what is in the bedroom?", "1 object in the bedroom: a bed"),
        ("what is in place 3?", "0 objects in place 3 by name, and 1 thing without a name"),
        (
            "list all objects",
            "The map has 3 objects: a banana, a cup, a bed, and 3 things without a name "
            "(2 in place 1, 1 in place 3)",
        ),
        ("how many cups are there?", "cup: 1"),
    ],
)
def test_answers_count_them_beside_the_objects(question: str, line: str) -> None:
    with in_memory_map() as flat:
        assert answer_question(with_unnamed(flat), question).lines == (line,)


def test_a_size_has_its_longer_side_first() -> None:
    assert sized("table 1", np.array([0.6, 1.5, 0.1]), 0.7) == (
        "The top of table 1 is 0.75 m above the floor; the part that was seen is 1.50 m wide, "
        "0.60 m deep and 0.10 m high"
    )
