"""Names of places: the everyday name of a kind, and when a place is called by it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from kg.model.records import likeliest

SURE: Final = 0.5  # belief in a place's category from which on it is named without "perhaps"
NUMBERED: Final = re.compile(r"(?:place|room) \d+")  # as mappers label places
#: The catalogue calls a bathroom what Places205 calls it.
_PLAIN: Final = {"shower": "bathroom", "lobby": "entrance hall"}


def plain_place(label: str) -> str:
    """The everyday name of a category of places, by its label."""
    return _PLAIN.get(label, label)


def sure_kind(beliefs: Mapping[str, float], label: Callable[[str], str]) -> str:
    """The everyday name of the category that is believed, by its `label`; "" where it is unsure."""
    best = likeliest(beliefs)
    return "" if best is None or beliefs[best] < SURE else plain_place(label(best))


def is_of_mapper(iri: str, label: str) -> bool:
    """Whether a mapper gave a place its label, and no person: ``room 101`` is a person's name."""
    kind, number = label[:4], iri.rpartition("/")[2]
    return bool(NUMBERED.fullmatch(label)) and (kind != "room" or label == f"room {number}")


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
    places: Iterable[tuple[str, str, Mapping[str, float]]], label: Callable[[str], str]
) -> list[str]:
    """Title of each place (IRI, label, beliefs): its kind, if it alone has it and has no name.

    Else its label, with its kind in brackets.
    """
    given = list(places)
    kinds = [sure_kind(beliefs, label) for _, _, beliefs in given]
    count = Counter(kinds)
    return [
        kind
        if kind and count[kind] == 1 and is_of_mapper(iri, name)
        else name + in_brackets(name, beliefs, label)
        for kind, (iri, name, beliefs) in zip(kinds, given, strict=True)
    ]
