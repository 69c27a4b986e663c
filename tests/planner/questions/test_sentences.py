"""Sentences of questions: each file's own sentences are read as what they ask."""

import re
from typing import get_args

import pytest

from planner.questions.clues import readings
from planner.questions.patterns import Kind, parsed
from planner.questions.sentences import Language, Sentence, languages

#: texts for gaps by their names, and by the shapes that they take
KINDS = {kind for some in get_args(Kind) for kind in get_args(some)}
_TEXTS = {
    "what": "cup",
    "where": "kitchen",
    "other": "bed",
    "when": "monday",
    "name": "cup",
    "numbered": "cup 2",
    "place": "place 3",
    "large": "the kitchen",
    "one": "the kitchen",
    "span": "last week",
    "use": "sit",
    "anything": "something to sit on",
    "word": "küche",
    "put": "hingelegt",
}


def _example(sentence: Sentence) -> str:
    """The shortest text of a sentence, with the first of its alternatives."""
    text, before = sentence.template, ""
    while text != before:
        before = text
        text = re.sub(r"\[[^\[\]()]*\]", "", text)
        text = re.sub(r"\(([^\[\]()|]*)(?:\|[^\[\]()]*)?\)", r"\1", text)

    def gap(found: re.Match[str]) -> str:
        shape = found[1] or found[2]
        values = sentence.language.lists.get(shape)
        return next(iter(values)) if values else _TEXTS.get(shape, _TEXTS.get(found[2], "cup"))

    return " ".join(re.sub(r"\{(?:(\w+):)?(\w+)\}", gap, text.split("|")[0]).split())


@pytest.mark.parametrize("language", languages(), ids=lambda one: one.name)
def test_no_sentence_hides_one_of_another_kind(language: Language) -> None:
    for sentence in language.questions:
        found = language.read(language.plain(_example(sentence)))
        assert found is not None, sentence.template
        assert found["kind"] == sentence.fields["kind"], (_example(sentence), found)
        assert found["kind"] in (*KINDS, "order")


def test_each_language_asks_of_every_kind() -> None:
    for language in languages():
        asked = {one.fields["kind"] for one in language.questions}
        assert asked | {one.kind for one in readings()} >= KINDS


@pytest.mark.parametrize("text", ["what is " + "a, " * 95, "is there " * 33])
def test_long_nonsense_is_refused(text: str) -> None:
    assert parsed(text) is None


def test_a_word_that_is_known_is_not_respelt() -> None:
    assert parsed("shwo the cup", known=lambda name: False) is None
    found = parsed("wher is the cup")
    assert found is not None and found.read_as == "where is the cup"
    assert parsed("ehre is the cup", known=lambda name: name == "ehre") is None
