"""Answers on the wire: one line of JSON without empty fields, of bounded length, page by page."""

from __future__ import annotations

import json
from typing import Any, Final

from hereabouts.agents.answers import Answer, Page
from hereabouts.agents.untrusted_text import escaped
from kg.model.errors import QueryParameterError

#: maximum characters of an answer: 1,500 tokens of four characters with what the protocol adds. An
#: answer is sent twice, as text, in which quotes are escaped, and as structured content.
MAX_CHARACTERS: Final = 5_800
SHORT: Final = 80  # characters of each text where there is no room for whole ones


def document_of(answer: Answer, base: str) -> dict[str, Any]:
    """An answer as plain values: without empty fields, and with IRIs relative to `base`.

    A list that is too long is cut; `more` is then the `skip` of the next page. Raises
    QueryParameterError if a single entry is too long, even with texts of `SHORT` characters.
    """
    document: dict[str, Any] = _lean(answer.model_dump(mode="json"), base)
    if _length(document) > MAX_CHARACTERS and not isinstance(answer, Page):
        shorter: dict[str, Any] = _shortened(document)
        return shorter
    if not isinstance(answer, Page):
        return document
    entries = document.setdefault(answer.listed, [])
    document.pop("skip", None)
    while True:
        if (more := answer.skip + len(entries)) < answer.total and entries:
            document["more"] = more
        if _length(document) <= MAX_CHARACTERS:
            return document
        if len(entries) > 1:
            entries.pop()
            continue
        document = _shortened(document)
        if _length(document) <= MAX_CHARACTERS:
            return document
        raise QueryParameterError(
            "an entry of this answer is too long; ask for less of it, such as fewer columns"
        )


def _shortened(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _shortened(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_shortened(item) for item in value]
    return escaped(value, SHORT) if isinstance(value, str) else value


def _length(document: dict[str, Any]) -> int:
    text = text_of(document)
    return len(text) + len(json.dumps(text, ensure_ascii=False))


def text_of(document: dict[str, Any]) -> str:
    """The JSON of an answer in one line."""
    return json.dumps(document, ensure_ascii=False, separators=(",", ":"))


def _lean(value: Any, base: str, *, marked: bool = False) -> Any:
    """`value` without None and "" in its objects; texts that are not `marked` lose `base`."""
    if isinstance(value, dict):
        return {
            key: _lean(item, base, marked=key.startswith("untrusted_") or key == "base")
            for key, item in value.items()
            if item is not None and item != ""
        }
    if isinstance(value, list):
        return [_lean(item, base, marked=marked) for item in value]
    if isinstance(value, str) and not marked:
        return value.removeprefix(base) or value
    return value
