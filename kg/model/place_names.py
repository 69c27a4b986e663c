"""Names of places: the everyday name of a kind, when a place is called by it, and articles."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from kg.model.records import PlaceRecord, likeliest

SURE: Final = 0.5  # belief in a place's category from which on it is named without "perhaps"
NUMBERED: Final = re.compile(r"(?:place|room) \d+")  # as mappers label places
_LONG: Final = 6  # letters of a kind from which on the end of a word is hardly it by chance
_DETERMINERS: Final = frozenset(
    ("the", "a", "an", "my", "our", "your", "his", "her", "its", "their", "this", "that")
)
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


def likely_kind(beliefs: Mapping[str, float], label: Callable[[str], str]) -> str:
    """The everyday name of the likeliest category, by its `label`: ``kitchen``; ``perhaps kitchen``
    where it is unsure, and "" without any.
    """
    top = likeliest(beliefs)
    kind = "" if top is None else plain_place(label(top))
    return f"perhaps {kind}" if kind and not sure_kind(beliefs, label) else kind


def in_brackets(name: str, beliefs: Mapping[str, float], label: Callable[[str], str]) -> str:
    """`` (kitchen)``, or `` (perhaps kitchen)``; "" where the name of the place has it already."""
    kind = likely_kind(beliefs, label)
    return f" ({kind})" if kind and not kind_in(name, kind.removeprefix("perhaps ")) else ""


def titled(place: PlaceRecord, label: Callable[[str], str]) -> str:
    """``place 6 (kitchen)``: the label of a place with its kind."""
    return place.label + in_brackets(place.label, place.beliefs, label)


def kind_in(name: str, kind: str) -> bool:
    """Whether a name has a kind of place: as words, or at the end of one (``redkitchen``)."""
    words = re.sub(r"[\W\d_]+", " ", f" {name} ").casefold()
    glued = kind.casefold().replace(" ", "")
    return f" {kind.casefold()} " in words or (len(glued) >= _LONG and f"{glued} " in words)


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


def spoken_titles(
    places: Iterable[tuple[str, str, Mapping[str, float]]],
    label: Callable[[str], str],
    is_noun: Callable[[str], bool],
) -> dict[str, str]:
    """The titles of `place_titles` with their articles, by IRI: ``the kitchen``."""
    given = list(places)
    return {
        iri: with_article(name, is_noun) + title.removeprefix(name)
        if title.startswith(name)
        else f"the {title}"
        for (iri, name, _), title in zip(given, place_titles(given, label), strict=True)
    }


def indefinite(noun: str) -> str:
    """A noun with its article: ``a cup``, ``an office``."""
    return f"{'an' if noun[:1].lower() in tuple('aeiou') else 'a'} {noun}"


def with_article(label: str, is_noun: Callable[[str], bool]) -> str:
    """A place's label in a sentence: ``the guest room``; ``place 3``, ``my den``, ``Ann's``.

    Labels take an article where their last word is a common noun, and no other word is before it
    that stands for one. Other names stay as people gave them.
    """
    name = label.partition(" (")[0]
    if NUMBERED.fullmatch(name):
        return label
    first, *_, last = name.split() * 2 or ["", ""]
    determined = first in _DETERMINERS or "'" in label
    return f"the {label}" if label.islower() and not determined and is_noun(last) else label
