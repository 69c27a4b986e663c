"""Answers to plain questions, of one moment or the past, about one thing or several."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from typing import Final

from kg.history.timestamps import iso, spoken
from kg.knowledge.ontology.catalogue import name_key
from kg.knowledge.words.tables import word_table
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UndetectableError, UnknownCategoryError, UnknownQueryError
from mapping.looks.word_looks import compares_texts
from planner.questions.answerer import Answerer, example_questions
from planner.questions.moments import past
from planner.questions.patterns import MAX_LENGTH, PlainAnswer, Question, ordered, parsed
from planner.questions.recognition import is_known_word, target_named
from planner.questions.rooms import WHOLE, about_rooms
from planner.search.goals.place_names import spoken_places
from planner.search.goals.targets import undetectable_target
from planner.search.plans.find import plan_words
from planner.search.plans.report import empty_answer

_MAX_ORDERED: Final = 3  # words of an order's thing that are repeated
#: columns of answers that have the IRI of a thing or place
_LISTING: Final = ("object", "thing", "place", "robot")


def answer_question(
    semantic_map: SemanticMap, text: str, now: float | None = None, language: str = ""
) -> PlainAnswer:
    """The answer to a question, at `now` [s since 1970], by default the clock's time.

    `language` limits the languages that the question is read in: ``de``, or ``de, en``.

    Raises:
        UnknownQueryError: the question is not understood; the message has questions that are.
        UnknownCategoryError: a word in it is unknown.
        QueryParameterError: no place, or no thing, has a name in it, or `language` is none.
    """
    question = _parsed(semantic_map, text, language)
    if question is None:
        raise UnknownQueryError(_not_understood(semantic_map, text))
    now = time.time() if now is None else now
    if not question.at:
        answer = _answered(semantic_map, question, now)
        return replace(answer, lines=(*question.notes, *answer.lines))
    then = past(question.at, now)
    with semantic_map.at(iso(then)) as before:
        answer = _answered(before, question, then)
    lines = *question.notes, f"As the map was {spoken(then)}:", *answer.lines
    return replace(answer, query="", parameters={}, lines=lines)


def _answered(semantic_map: SemanticMap, question: Question, now: float) -> PlainAnswer:
    """The answer, or several one below the other where the question is about several things."""
    answers = []
    for what in (question.what, *question.also):
        try:
            one = Answerer(semantic_map, replace(question, what=what), now).answer()
        except UndetectableError as error:
            one = PlainAnswer(question.kind, "", {}, (str(error),))
        named = f"{what}: " * bool(question.also)
        answers.append(replace(one, lines=(named + one.lines[0], *one.lines[1:])))
    things = tuple(iri for one in answers for iri in _listed_in(one))
    lines = tuple(line for one in answers for line in one.lines)
    return replace(answers[0], lines=lines, things=things)


def _parsed(semantic_map: SemanticMap, text: str, language: str = "") -> Question | None:
    question = parsed(text, cache(partial(_is_name, semantic_map)), language)
    if question is None and ordered(text) and is_known_word(semantic_map, text):
        question = Question("where", what=text)  # a stop sign or a water bottle, no order
    if question is None:
        return None
    question = replace(question, what=_by_number(question.what), other=_by_number(question.other))
    if question.where in WHOLE and question.kind != "route":
        labels = {place.label.casefold() for place in semantic_map.places()}
        return question if question.where in labels else replace(question, where="")
    return question


def _by_number(words: str) -> str:
    """``object/12`` for ``object 12``."""
    return re.sub(r"^object (\d+)$", r"object/\1", words)


def _is_name(semantic_map: SemanticMap, words: str) -> bool:
    """Whether words are the name of a category, or of one thing, as ``can opener`` is."""
    listed = " " in words and name_key(words) in word_table().senses
    if listed or semantic_map.catalogue.get(words) is not None:
        return True
    return bool(words) and bool(semantic_map.resolve("thing", words))


def _not_understood(semantic_map: SemanticMap, text: str) -> str:
    if thing := ordered(text):
        name = thing if len(thing.split()) <= _MAX_ORDERED else "the thing"
        return f"not understood: this answers questions and moves no robot; ask where {name} is"
    shown = " ".join(text.split())
    shown = f"{shown[:60]!r}{' ...' if len(shown) > 60 else ''}" if shown else "an empty text"
    limit = f" of at most {MAX_LENGTH} characters" if len(text) > MAX_LENGTH else ""
    examples = " / ".join(example_questions(semantic_map))
    return f"not understood: {shown}; questions{limit} that are: {examples}"


def answer_box(semantic_map: SemanticMap, wanted: Sequence[str]) -> dict[str, object]:
    """Answer of the page's box, as `find --json` has it: a plan for things, or sentences alone.

    `query` and `parameters` name the shipped query that has the facts; "" where none has.

    Raises as `answer_question` and `plan_words`.
    """
    question = _parsed(semantic_map, wanted[0]) if len(wanted) == 1 else None
    seen = _by_looks(semantic_map, wanted, question)
    if seen is not None:
        return seen
    if question is None:
        found = _found(semantic_map, wanted)
        behind = _query_of(semantic_map, *wanted)
        return {**found, **behind, "about": about(semantic_map, _texts(found["answer"]))}
    now = time.time()
    rooms = about_rooms(semantic_map, question, now)
    alone = not (rooms or question.also or question.at or question.where)
    if question.kind == "where" and alone:
        with suppress(UndetectableError):  # that has its own answer
            target_named(semantic_map, question.what)
        found = plan_words(semantic_map, [question.what]).to_json()
        lines = [*question.notes, *_texts(found["answer"])]
        behind = _query_of(semantic_map, question.what)
        return {**found, **behind, "answer": lines, "about": about(semantic_map, lines)}
    answer = answer_question(semantic_map, wanted[0], now)
    # of several times one is told; the things of the other rows are not what it is about
    listed = () if answer.kind == "last seen" else answer.things
    return {
        **empty_answer(semantic_map, (), now),
        "target": wanted[0],
        "answer": list(answer.lines),
        "query": answer.query,
        "parameters": dict(answer.parameters),
        "about": about(semantic_map, answer.lines, listed),
    }


def _by_looks(
    semantic_map: SemanticMap, wanted: Sequence[str], question: Question | None
) -> dict[str, object] | None:
    """The answer about one thing that only the encoder of the map can tell; else None."""
    if len(wanted) != 1 or not compares_texts(semantic_map):
        return None
    text = wanted[0] if question is None else question.what
    if question is not None and (question.kind != "where" or question.also or question.at):
        return None
    unseen = undetectable_target(semantic_map, text)
    if unseen is None or unseen.alike is None:
        return None
    lines = [f"{line}." for line in unseen.sentences]
    listed = [one.iri for one in unseen.alike.found.things[: len(unseen.alike.things)]]
    return {
        **empty_answer(semantic_map, (), time.time()),
        "target": wanted[0],
        "answer": lines,
        "about": about(semantic_map, lines, listed),
    }


def _query_of(semantic_map: SemanticMap, what: str, *more: str) -> dict[str, object]:
    """The shipped query for the things of one category; no query for other words."""
    is_category = not more and semantic_map.catalogue.get(what, "object") is not None
    query, given = ("objects-by-category", {"category": what}) if is_category else ("", {})
    return {"query": query, "parameters": given}


def about(
    semantic_map: SemanticMap, lines: Sequence[str], listed: Sequence[str] = ()
) -> list[dict[str, str]]:
    """Things and places of an answer, for links: `iri`, and `name` as its lines have it, or "".

    Things and places whose names stand in the lines come first, then the IRIs `listed`.
    """
    text = "\n".join(lines)
    names = dict[str, str]()
    for place in semantic_map.places():
        names[place.label] = place.iri
    for iri, title in spoken_places(semantic_map).items():
        names[title.removeprefix("the ")] = iri
    rows = semantic_map.query("objects", least=0.0).records()
    names |= {str(row["label"]): str(row["object"]) for row in rows if row["label"]}
    named = {
        iri: name
        for name, iri in sorted(names.items(), key=lambda pair: len(pair[0]))
        if name in text and re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text)
    }
    first = sorted(named, key=lambda iri: text.index(named[iri]))
    rest = [semantic_map.base + iri if ":" not in iri else iri for iri in listed]
    order = dict.fromkeys([*first, *rest])
    return [{"iri": iri, "name": named.get(iri, "")} for iri in order]


def _listed_in(answer: PlainAnswer) -> list[str]:
    """IRIs of the things and places that an answer lists."""
    columns = [n for n, name in enumerate(answer.columns) if name in _LISTING]
    cells = [row[columns[0]] for row in answer.rows] if columns else []
    return [*answer.things, *(cell for cell in cells if isinstance(cell, str))]


def _found(semantic_map: SemanticMap, wanted: Sequence[str]) -> dict[str, object]:
    """The plan as JSON; a text that is neither a question nor a name is refused as `ask` has it."""
    try:
        return plan_words(semantic_map, wanted).to_json()
    except UndetectableError:
        raise
    except UnknownCategoryError:
        if len(wanted) > 1:
            raise
        raise UnknownQueryError(_not_understood(semantic_map, wanted[0])) from None


def _texts(value: object) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else []
