"""Scores answers to the questions, 0 to 1 each, by the type of the answer.

    python scoring.py questions.json answers.json

This file needs Python 3.11 and nothing else, so that any system can be scored. `answers.json` is an
object of {question's id: answer}; an absent answer scores 0.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

OVERLAP: Final = 0.5  # of two boxes, from which on a picture shows the thing


def score(question: Any, given: Any) -> float:
    """0..1; 0 for an answer of another type and for none.

    `question` has the fields of an entry of questions.json as attributes.
    """
    if given is None:
        return 0.0
    try:
        return float(_SCORES[question.type](question, given))
    except (TypeError, ValueError, IndexError, OverflowError, KeyError):
        return 0.0


def _exact(question: Any, given: Any) -> bool:
    return type(given) is type(question.answer) and given == question.answer


def _near(question: Any, given: Any) -> bool:
    away = math.dist([float(c) for c in given[:2]], question.answer[:2])
    return away <= (question.tolerance or 0.0)


def _within(question: Any, given: Any) -> bool:
    return abs(float(given) - float(question.answer)) <= (question.tolerance or 0.0)


def _f1(question: Any, given: Any) -> float:
    if isinstance(given, str):
        return 0.0
    true, found = (set(listed) - set(question.ignore) for listed in (question.answer, given))
    return 2 * len(true & found) / (len(true) + len(found)) if true or found else 1.0


def _one_of(question: Any, given: Any) -> bool:
    return list(given) in [list(one) for one in question.answer]


def _first_right(question: Any, given: Any) -> bool:
    return not isinstance(given, str) and bool(given) and given[0] in question.answer


def _overlapping(question: Any, given: Any) -> bool:
    recording, frame, *box = given
    of_frame = (one[2:] for one in question.answer if list(one[:2]) == [recording, frame])
    return any(_overlap(one, [float(c) for c in box]) >= OVERLAP for one in of_frame)


def _overlap(one: Any, other: Any) -> float:
    """Intersection over union of two boxes x0, y0, x1, y1."""
    sides = [min(one[k + 2], other[k + 2]) - max(one[k], other[k]) for k in (0, 1)]
    both = max(sides[0], 0.0) * max(sides[1], 0.0)
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (one, other))
    return both / (areas - both) if areas > both else 0.0


_SCORES: Final[Mapping[str, Callable[[Any, Any], float]]] = {
    "integer": _exact,
    "integer or not known": _exact,
    "boolean": _exact,
    "status": _exact,
    "position": _near,
    "metres": _within,
    "time": _within,
    "categories": _f1,
    "frame": _one_of,
    "crop": _overlapping,
    "rooms": _first_right,
}


def main(files: list[str]) -> int:
    """Print the mean score of each family."""
    if len(files) != 2:
        print(__doc__, file=sys.stderr)  # noqa: T201
        return 2
    try:
        document, answers = (json.loads(Path(file).read_text("utf-8")) for file in files)
        questions = [SimpleNamespace(**entry) for entry in document["questions"]]
        given = {one.id: answers.get(one.id) for one in questions}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        print(f"scoring needs questions.json and an object of answers: {error}", file=sys.stderr)  # noqa: T201
        return 1
    scores: dict[str, list[float]] = {}
    for one in questions:
        scores.setdefault(one.family, []).append(score(one, given[one.id]))
    scores["all"] = [value for family in scores.values() for value in family]
    for family, values in scores.items():
        print(f"{family:16} {len(values):5} {sum(values) / len(values):6.3f}")  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
