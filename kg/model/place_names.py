"""Names of places: the everyday name of a kind, and when a place is called by it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from kg.model.records import likeliest

SURE: Final = 0.5  # belief in a place's category from which on it is named without "perhaps"
NUMBERED: Final = re.compile(r"(?:place|room) \d+")  # the label of a place that nobody named
#: The catalogue calls a bathroom what Places205 calls it.
_PLAIN: Final = {"shower": "bathroom", "lobby": "entrance hall"}


def plain_place(label: str) -> str:
    """The everyday name of a category of places, by its label."""
    return _PLAIN.get(label, label)


def sure_kind(beliefs: Mapping[str, float], label: Callable[[str], str]) -> str:
    """The everyday name of the category that is believed, by its `label`; "" where it is unsure."""
    best = likeliest(beliefs)
    return "" if best is None or beliefs[best] < SURE else plain_place(label(best))


def distinct_kinds(places: Sequence[tuple[str, str]]) -> list[str]:
    """The kind of each place (label, kind) that it alone has and nobody named; "" for others."""
    count = Counter(kind for _, kind in places)
    return [
        kind if count[kind] == 1 and NUMBERED.fullmatch(label) else "" for label, kind in places
    ]


def in_brackets(name: str, beliefs: Mapping[str, float], label: Callable[[str], str]) -> str:
    """`` (kitchen)``, or `` (perhaps kitchen)``; "" where the name of the place has it already."""
    top = likeliest(beliefs)
    kind = "" if top is None else plain_place(label(top))
    letter = "[^\\W\\d_]"
    word = rf"(?<!{letter}){re.escape(kind)}(?!{letter})"
    if top is None or not kind or re.search(word, name, re.IGNORECASE):
        return ""
    return f" ({kind})" if beliefs[top] >= SURE else f" (perhaps {kind})"


def place_titles(
    places: Iterable[tuple[str, Mapping[str, float]]], label: Callable[[str], str]
) -> list[str]:
    """Title of each place (label, beliefs): its kind if it alone has it, else label and kind."""
    given = list(places)
    kinds = distinct_kinds([(name, sure_kind(beliefs, label)) for name, beliefs in given])
    return [
        kind or name + in_brackets(name, beliefs, label)
        for kind, (name, beliefs) in zip(kinds, given, strict=True)
    ]
