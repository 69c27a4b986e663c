"""Answers without any map: what the other houses' answers and common sense alone give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from kg.maps.room_statistics import placement_table
from kg.maps.semantic_map import SemanticMap
from lab.questions.question_file import HouseQuestion
from lab.questions.scoring import score
from planner.search.goals.search_goals import resolve_target


class BlindAnswers:
    """Answers of the other houses that would have scored best, and places by common sense.

    `nothing` is a map of nothing, for its ontology.
    """

    def __init__(self, questions: Sequence[HouseQuestion], nothing: SemanticMap) -> None:
        self._questions, self._catalogue = questions, nothing.catalogue
        self._table = placement_table(nothing)

    def answer(self, question: HouseQuestion) -> Any:
        """An answer from the words of the question alone."""
        if question.type == "rooms":
            return self._likely_rooms(question)
        others = [
            one
            for one in self._questions
            if one.family == question.family and one.house != question.house
        ]
        wanted = question.parameters.get("category")
        same = [one for one in others if wanted and one.parameters.get("category") == wanted]
        return _best_constant(same or others)

    def _likely_rooms(self, question: HouseQuestion) -> list[str]:
        """Rooms that other questions name, by the probability that such a room has the thing."""
        named = (one for one in self._questions if one.house == question.house)
        rooms = {v for one in named for k, v in one.parameters.items() if k.endswith("room") and v}
        kind = resolve_target(self._catalogue, question.parameters["category"]).iri

        def chance(room: str) -> float:
            category = self._catalogue.get(room.rstrip(" 0123456789"))
            return 0.0 if category is None else self._table.probability(kind, category.iri)

        return sorted(rooms, key=lambda room: (-chance(room), room))


def _best_constant(questions: Sequence[HouseQuestion]) -> Any:
    """The one answer that scores best on all of `questions`."""
    if not questions:
        return None
    options = [_given(one) for one in questions]
    counted = Counter(map(repr, options))

    def worth(option: Any) -> tuple[float, int]:
        return sum(score(one, option) for one in questions), counted[repr(option)]

    return max(options, key=worth)


def _given(question: HouseQuestion) -> Any:
    """The answer of a question as somebody would give it."""
    return question.answer[0] if question.type == "frame" else question.answer
