"""Questions that no sentence has: what their clues say, and what may not be left over."""

import re
import tomllib

import pytest

from planner.questions.clues import READINGS, read_clues
from planner.questions.patterns import parsed
from planner.questions.sentences import languages


@pytest.mark.parametrize(
    ("text", "kind", "names"),
    [
        ("the mug, where did it go this time", "where", ("mug", "", "")),
        ("any idea where the backpack ended up?", "where", ("backpack", "", "")),
        ("so which room did anybody leave the vase in", "where", ("vase", "", "")),
        ("the kitchen - what do we have in there?", "in place", ("", "kitchen", "")),
        ("is the cup in the kitchen or in the bedroom", "where", ("cup", "", "")),
        ("nearest object to the oven", "around", ("", "", "oven")),
        ("the chair, is it still in place 4", "status", ("chair", "place 4", "")),
        ("how do I get to the bathroom from the hallway", "route", ("", "bathroom", "")),
        ("was the cup in the kitchen yesterday, do you know", "status", ("cup", "kitchen", "")),
        ("distance between robot and couch", "distance", ("couch", "", "robot")),
        ("laptop in the office since when?", "last seen", ("laptop", "office", "")),
        ("the vase, how long has it been on the table", "last seen", ("vase", "", "table")),
        ("chairs in the office, at least three?", "count", ("chairs", "office", "")),
        ("count chairs office", "count", ("chairs", "office", "")),
        ("I need something to cut the bread with", "where", ("something to cut with", "", "")),
        ("Have you anything for sitting?", "where", ("something to sit on", "", "")),
        ("which way is the bathroom", "route", ("", "bathroom", "")),
        ("Where I can find the cup", "where", ("cup", "", "")),
        ("seit wann steht der Koffer im Flur", "last seen", ("koffer", "flur", "")),
        ("ich brauche etwas zum Brot schneiden", "where", ("something to cut with", "", "")),
        ("sag mal, der Koffer, wo ist der hin", "where", ("koffer", "", "")),
        ("weiß jemand wo das Buch hingekommen ist", "where", ("buch", "", "")),
        ("ist die Tasse im Bad oder in der Küche", "where", ("tasse", "", "")),
        ("yo whats under the sofa", "under", ("", "", "sofa")),
        ("do u think the mug's on the shelf pls", "status", ("mug", "", "shelf")),
        ("um how many uh vases are in the office", "count", ("vases", "office", "")),
        ("has the office a clock", "status", ("clock", "office", "")),
        ("is the vase where it was yesterday", "changed", ("vase", "", "")),
        ("steht die Vase noch da wo sie gestern stand", "changed", ("vase", "", "")),
    ],
)
def test_the_order_of_clues_and_names_does_not_matter(text, kind, names):
    question = parsed(text)
    assert question is not None
    assert question.kind == kind
    where = "" if question.start else question.where
    assert (question.what, where, question.other) == names or kind == "route"


@pytest.mark.parametrize(
    ("text", "at", "when", "number"),
    [
        ("where was the cup at half past nine", "9:30", "", 0),
        ("laptop location yesterday at 14:30", "yesterday at 14:30", "", 0),
        ("what moved since 9:30", "", "9:30", 0),
        ("wo war die Tasse um halb zehn", "9:30", "", 0),
        ("are there more than three cups", "", "", 4),
        ("do we have enough cups", "", "", 0),
        ("sind mehr als drei Tassen im Bad", "", "", 4),
    ],
)
def test_times_and_numbers_are_read(text: str, at: str, when: str, number: int) -> None:
    question = parsed(text)
    assert question is not None
    assert (question.at, question.when, question.number) == (at, when, number)


def test_words_of_another_language_are_no_name() -> None:
    english = parsed("how reliable is laptop position")  # "position" is a German clue, too
    assert english is not None and english.kind == "certainty" and english.what == "laptop"


@pytest.mark.parametrize(
    "text",
    [
        *("where is the cup that she broke", "what is to the left of the bed"),
        *("what did the kids leave in the bathroom", "is the cup under or on the table"),
        *("was there a sink in the corridor", "please move the vase", "is the cup new"),
        *("did the cat take the banana", "why is the cup", "where did the cup move"),
        *("laptop location at 9:30 last week", "how long has the tv been on"),
        *("how much is the laptop", "how many chairs around the table"),
        *("wo ist die Tasse die Anna zerbrochen hat", "wer hat die Tasse verstellt"),
    ],
)
def test_no_word_is_left_out(text: str) -> None:
    assert all(read_clues(language, language.plain(text)) is None for language in languages())


def test_readings_have_the_clues_of_a_language() -> None:
    file = tomllib.loads(READINGS.read_text(encoding="utf-8"))
    for language in languages():
        named = {*language.table("clues"), *language.table("prepositions")}
        assert {"where", "what", "is", "in"} <= named
    every = {
        name for one in languages() for t in ("clues", "prepositions") for name in one.table(t)
    }
    for lines in file["readings"].values():
        for line in lines:
            clues, _, names = line.partition("/")
            befores = [one.rpartition(":")[0] for one in re.findall(r"[^\s\[\]]+", names)]
            used = {*re.findall(r"\w+", clues), *re.findall(r"\w+", " ".join(befores))}
            assert used <= {*every, "hanging"}, line
