"""Score of plain questions: `python -m benchmarks.plain_questions FILE.csv ...`.

Each row has a question, the kind of its answer, and the category and place that it names. It is
right if all three are so understood, wrong if they are understood otherwise, and open if the
question is refused. The first fifty were written before the rules. The second fifty were written
after them and scored once; then they changed the rules. The third fifty were written next, and
nothing was changed by them. The fourth part was written after the rules on the past, sizes,
distances and several things; nothing was changed by it either. The fifth part has the questions of
a list that was written before the rules on neighbours, comparisons, the nearest thing and help.
`household` and `held_out` are the halves of one list of 92 questions, 23 of them German and 12
without an answer, which was written before any rule for it. Rules may be tuned on `household`,
never on `held_out`, nor on `robot`, which was written later for the same purpose. `family`,
`operator` and `second_language` (of people who learnt English later) were written before any of the
sentences was read; clues were tuned on `family`, and on `operator` after it was scored once, and
later on `second_language`. `german` was written after the clues, and tuned on then. `elderly`,
`technician` and `chat` were written next, before their writer read a sentence or a clue, and scored
once; then clues were tuned on the first two. `nurse`, `voice` and `flat_sharer` were written in the
same way; then clues were tuned on all of these. Of `visitor`, forty were written before the rules
were changed and forty after; then rules were tuned on all eighty. `visitor_held_out` was written
after that and scored once (30 of 40 right, 7 open, 3 wrong); then three of its labels were
corrected. `last seen` has the first sighting, too, so it is also right where people ask since when
something is there. In the first five, four questions have kinds that came later (count, route,
largest, changed), and three are orders, which are refused since.
Several categories are joined by "|", and kinds of which each is right by "/"; `when` is a moment.
"""

from __future__ import annotations

import csv
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from hereabouts.cli.console import print_table, write
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError
from kg.serving.opening import in_memory_map
from lab.command_line import parser_of
from planner.questions.patterns import ROBOT, Question, parsed
from planner.questions.recognition import target_named
from planner.questions.rooms import WHOLE, WITHOUT_CATEGORY
from planner.search.goals.place_names import place_category

PARTS: Final = tuple(
    Path(__file__).with_name(f"{name}.csv")
    for name in ("first", "second", "third", "fourth", "fifth")
)
HOUSEHOLD: Final = tuple(
    Path(__file__).with_name(f"{name}.csv")
    for name in (
        "household",
        "held_out",
        "robot",
        "family",
        "operator",
        "second_language",
        "german",
        "elderly",
        "technician",
        "chat",
        "nurse",
        "voice",
        "flat_sharer",
        "visitor",
        "visitor_held_out",
    )
)


def understood(semantic_map: SemanticMap, text: str) -> tuple[str, str, str]:
    """Kind, category and place of a question; ``none`` for one that is refused."""
    return _understood(semantic_map, parsed(text))


def _understood(semantic_map: SemanticMap, question: Question | None) -> tuple[str, str, str]:
    if question is None:
        return "none", "", ""
    about, where = [question.what or question.other, *question.also], question.where
    if question.what and question.other:
        about.append("" if question.other in ("door", ROBOT) else question.other)
        where = question.other
    if question.kind == "in place":
        about = []
    names = [_name(semantic_map, one) if one else "" for one in about]
    if None in names or (question.where and not _is_place(semantic_map, question.where)):
        return "none", "", ""
    if question.what and question.other:
        where = names.pop() or where
    return question.kind, "|".join(filter(None, names)), where


def _is_place(semantic_map: SemanticMap, words: str) -> bool:
    """Whether a map can have a place, or a thing, of that name: answers refuse other words."""
    if words in WHOLE or place_category(semantic_map.catalogue, words) is not None:
        return True
    return _name(semantic_map, words) is not None


def _same(semantic_map: SemanticMap, one: str, other: str) -> bool:
    """Whether words name the same place, or kind of thing: a television is a tv."""
    one, other = ("" if words in WHOLE else words for words in (one, other))
    if one == other or not one or not other:
        return one == other
    category = place_category(semantic_map.catalogue, one)
    if category is not None:
        return category == place_category(semantic_map.catalogue, other)
    name = _name(semantic_map, one)
    return name is not None and name == _name(semantic_map, other)


def _name(semantic_map: SemanticMap, words: str) -> str | None:
    """Label of the category of things, or of places, that words name; None if they name none."""
    if re.fullmatch(r"[a-z ]+ \d+", words):
        return words
    try:
        target = target_named(semantic_map, words)
        return target.label if target.iri else ", ".join(sorted(target.kinds.values()))
    except UnknownCategoryError:
        place = place_category(semantic_map.catalogue, words)
        return place.label if place else words if words in (*WHOLE, *WITHOUT_CATEGORY) else None


def scored(path: Path) -> Iterator[tuple[Mapping[str, str], str, tuple[str, str, str]]]:
    """Each row of a file with its verdict (right, open or wrong), and as it was understood."""
    with in_memory_map() as semantic_map, path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            question = parsed(row["question"])
            found = _understood(semantic_map, question)
            what = "|".join(_name(semantic_map, one) or "" for one in row["what"].split("|") if one)
            kinds = row["kind"].split("/")
            right = found[0] in kinds and found[1] == what
            right = right and _same(semantic_map, found[2], row["where"])
            right = right or found[0] == "none" in kinds
            if right and question is not None and (when := row.get("when")):
                right = when in f"{question.when} {question.at}"
            refused = "open" if found[0] == "none" else "wrong"
            yield row, "right" if right else refused, found


def main(argv: Sequence[str] | None = None) -> int:
    """Score the files, and list what is not right."""
    parser = parser_of("benchmarks.plain_questions", __doc__)
    parser.add_argument("files", nargs="*", type=Path, default=PARTS + HOUSEHOLD)
    rows, others = list[tuple[object, ...]](), list[str]()
    for path in parser.parse_args(argv).files:
        counts = Counter[str]()
        for row, verdict, found in scored(path):
            counts[verdict] += 1
            if verdict != "right":
                others.append(f"{verdict}: {row['question']} -> {', '.join(found)}")
        total = counts.total()
        rows.append((path.stem, total, *(counts[v] for v in ("right", "open", "wrong"))))
    print_table(("part", "questions", "right", "open", "wrong"), rows)
    write("\n".join(others))
    return 0


if __name__ == "__main__":
    sys.exit(main())
