"""Which texts are plain questions, and which words name things."""

from __future__ import annotations

import re
from typing import Final

from kg.maps.query.query_files import shipped_names
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError
from planner.search.goals.place_names import object_named
from planner.search.goals.target_words import any_meaning

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
