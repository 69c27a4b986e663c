"""Scores of answers: 0 to 1 for each question, by the type of its answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from benchmarks.questions.question_file import Question


def score(question: Question, given: Any) -> float:
    """0..1; 0 for an answer of another type and for none."""
    if given is None:
        return 0.0
    try:
        return float(_SCORES[question.type](question, given))
    except (TypeError, ValueError, IndexError, OverflowError):
        return 0.0


def _exact(question: Question, given: Any) -> bool:
    return type(given) is type(question.answer) and given == question.answer


def _near(question: Question, given: Any) -> bool:
    away = math.dist([float(c) for c in given[:2]], question.answer[:2])
    return away <= (question.tolerance or 0.0)


def _then(question: Question, given: Any) -> bool:
    return abs(float(given) - float(question.answer)) <= (question.tolerance or 0.0)


def _f1(question: Question, given: Any) -> float:
    if isinstance(given, str):
        return 0.0
    true, found = (set(listed) - set(question.ignore) for listed in (question.answer, given))
    return 2 * len(true & found) / (len(true) + len(found)) if true or found else 1.0


def _one_of(question: Question, given: Any) -> bool:
    return list(given) in [list(one) for one in question.answer]


def _reciprocal_rank(question: Question, given: Any) -> float:
    right = (n for n, room in enumerate(given, start=1) if room in question.answer)
    return 0.0 if isinstance(given, str) else 1 / next(right, math.inf)


_SCORES: Final[Mapping[str, Callable[[Question, Any], float]]] = {
    "integer": _exact,
    "boolean": _exact,
    "status": _exact,
    "position": _near,
    "time": _then,
    "categories": _f1,
    "frame": _one_of,
    "rooms": _reciprocal_rank,
}
