"""Recognition of plain questions in texts, and of the words that name things."""

from __future__ import annotations

import re
from typing import Final

from kg.maps.query.query_files import shipped_names
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UndetectableError, UnknownCategoryError
from planner.search.goals.place_names import object_named
from planner.search.goals.target_words import any_meaning
from planner.search.goals.targets import Target, resolve

_SPARQL: Final = re.compile(
    r"(?:\s|#[^\n]*\n)*(?:select|ask|construct|describe|prefix|base|insert|delete)\b", re.IGNORECASE
)


def is_plain(text: str) -> bool:
    """Whether a text is to be read as a plain question, rather than as SPARQL or a query's name."""
    if text.endswith(".rq") or "{" in text or _SPARQL.match(text):
        return False
    return text not in shipped_names()


def is_known_word(semantic_map: SemanticMap, words: str) -> bool:
    """Whether words name things; typing errors, as in a room that is unknown, do not count."""
    if object_named(semantic_map, words):
        return True
    try:
        return any_meaning(semantic_map.catalogue, words).how != "spelling"
    except UnknownCategoryError:
        return False


def target_named(semantic_map: SemanticMap, words: str) -> Target:
    """The target that words name.

    Spelling never decides, since a word that nobody knows may be one. Raises as `resolve`, and
    UnknownCategoryError, with the word that is perhaps meant, for one that is perhaps misspelt.
    """
    try:
        (target,) = resolve(semantic_map, (words,))
    except UndetectableError:
        _ask_back(semantic_map, words)
        raise
    if target.note:
        _ask_back(semantic_map, words)
    return target


def _ask_back(semantic_map: SemanticMap, words: str) -> None:
    try:
        found = any_meaning(semantic_map.catalogue, words)
    except UnknownCategoryError:
        return  # the encoder of the map knows it
    if found.how == "spelling":
        raise UnknownCategoryError(f"nothing is called '{found.text}'; did you mean {found.word}?")
