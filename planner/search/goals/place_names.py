"""Names of places and objects of a map: what a text names, and how answers name things."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key
from kg.knowledge.words.tables import word_table
from kg.maps.query.parameter_resolution import places_of_kind
from kg.maps.semantic_map import SemanticMap
from kg.model import place_names
from kg.model.errors import QueryParameterError
from kg.model.records import PlaceRecord
from kg.model.vocabulary import UNNAMED_THING

_LISTED = 8  # places in a message or sentence
_UNNAMED = (
    *("unnamed thing", "unnamed things", "thing without a name", "things without a name"),
    *("unnamed object", "unnamed objects"),
)


def likely_kind(catalogue: Catalogue, place: PlaceRecord) -> str:
    """The kind of a place: ``kitchen``, or ``perhaps kitchen``; "" without any."""
    return place_names.likely_kind(place.beliefs, catalogue.label)


def spoken_places(semantic_map: SemanticMap) -> dict[str, str]:
    """Names of places (by IRI) in sentences: ``the kitchen``, or the label and kind."""
    catalogue = semantic_map.catalogue
    named = _named(semantic_map.places())
    return place_names.spoken_titles(named, catalogue.label, partial(_is_noun, catalogue))


def titled_places(semantic_map: SemanticMap) -> list[tuple[PlaceRecord, str]]:
    """Each place with its title, as the page, tables and pictures have it (`place_titles`)."""
    places = semantic_map.places()
    titles = place_names.place_titles(_named(places), semantic_map.catalogue.label)
    return list(zip(places, titles, strict=True))


def _named(places: Sequence[PlaceRecord]) -> list[tuple[str, str, Mapping[str, float]]]:
    return [(place.iri, place.label, place.beliefs) for place in places]


def titles_by_label(semantic_map: SemanticMap) -> dict[str, str]:
    """Titles of places by their labels, but for labels that several places have."""
    titled = titled_places(semantic_map)
    count = Counter(place.label for place, _ in titled)
    return {place.label: title for place, title in titled if count[place.label] == 1}


def in_words(catalogue: Catalogue, label: str) -> str:
    """A place's label in a sentence, with an article where it takes one (`with_article`)."""
    return place_names.with_article(label, partial(_is_noun, catalogue))


def _is_noun(catalogue: Catalogue, word: str) -> bool:
    """Whether a word is a kind of place, or another common noun."""
    return bool(catalogue.get(word, "place") or name_key(word) in word_table().senses)


def listed_places(semantic_map: SemanticMap) -> str:
    """``place 1 (kitchen), place 2 and 3 more``: the places of a map."""
    named = [place_names.titled(p, semantic_map.catalogue.label) for p in semantic_map.places()]
    return listed(named[:_LISTED], len(named[_LISTED:]))


def listed(named: Sequence[str], rest: int) -> str:
    """``a, b and 3 more``."""
    return ", ".join(named) + (f" and {rest} more" if rest else "")


def counted_unnamed(semantic_map: SemanticMap, place: str | None = None) -> str:
    """``3 things without a name``: those of a place (an IRI) or of the map; "" where none is.

    Those of a map are also counted by place, if they are in several.
    """
    found = semantic_map.query("unnamed-things").records()
    called = spoken_places(semantic_map)
    where = [
        (called.get(str(row["place"]), "no place"), int(str(row["count"])))
        for row in found
        if place in (None, row["place"])
    ]
    total = sum(n for _, n in where)
    if not total:
        return ""
    text = f"{total} thing{'s' if total > 1 else ''} without a name"
    if len(where) == 1:
        return text
    named = [f"{n} in {label}" for label, n in where[:_LISTED]]
    return f"{text} ({listed(named, sum(n for _, n in where[_LISTED:]))})"


def place_category(catalogue: Catalogue, text: str) -> Category | None:
    """The category of places that a name means; None for names of things, which come first."""
    return None if catalogue.get(text, "object") else catalogue.get(text, "place")


def places_called(semantic_map: SemanticMap, text: str) -> tuple[PlaceRecord, ...]:
    """Places of a category, else of its kinds by name: a home office where there is no office."""
    places = semantic_map.places()
    return tuple(places_of_kind(semantic_map.engine, semantic_map.catalogue, places, text))


def notes_of(semantic_map: SemanticMap, place: str) -> list[tuple[str, str]]:
    """The note of a person on a place (its IRI), and who wrote it; none, or one."""
    asserted = semantic_map.assertions.all(place)
    return [(one.value, one.by) for one in asserted if one.property == "note"]


@dataclass(frozen=True, slots=True)
class StatedCategory:
    """A person's word on what an object is, and what detectors take it for."""

    by: str
    category: str  # label
    given: str  # the name as given; "" for a category that is no name
    detected_as: str  # the detectors' own label; "" where they agree, or know none

    def words(self, label: str) -> str:
        """`` (so named by ann)``, or `` (called bowl by ann)`` of an object with another label."""
        called = "so named" if label in (self.category, self.given) else f"called {self.category}"
        return f" ({called} by {self.by})"


def stated_categories(semantic_map: SemanticMap) -> dict[str, StatedCategory]:
    """The objects whose category a person has asserted, by IRI."""
    catalogue, asserted = semantic_map.catalogue, semantic_map.assertions.all()
    given = {(a.subject, a.by, a.stamp): a.value for a in asserted if a.property == "label"}
    return {
        one.subject: StatedCategory(
            one.by,
            catalogue.label(one.value),
            given.get((one.subject, one.by, one.stamp), ""),
            catalogue.label(one.perceived)
            if one.perceived not in (None, one.value, UNNAMED_THING)
            else "",
        )
        for one in asserted
        if one.property == "category"
    }


def is_unnamed(text: str) -> bool:
    """Whether words mean the things that nobody named: ``unnamed things``."""
    words = text.strip().casefold().removeprefix("the ")
    return text == UNNAMED_THING or words in _UNNAMED


def object_named(semantic_map: SemanticMap, text: str) -> str:
    """IRI of the object that a label (``cup 2``, ``the red cup``), ``object/2`` or an IRI names.

    "" for any other text, and for a category that several objects have as their label. Raises
    QueryParameterError for another label of several objects, and for a category with a number that
    no object has (``cup 99``); the message lists those that there are.
    """
    catalogue = semantic_map.catalogue
    try:
        iri = semantic_map.resolve("thing", text)
    except QueryParameterError:
        if catalogue.get(text) is None:
            raise
        return ""
    category, _, number = text.strip().rpartition(" ")
    is_numbered = number.isdigit() and catalogue.get(category, "object")
    if not iri and is_numbered and not catalogue.get(text):
        return semantic_map.resolve("iri", text)
    return iri if iri.startswith(f"{semantic_map.base}object/") else ""


def fact_named(semantic_map: SemanticMap, text: str) -> str:
    """A thing by its name, or a fact of it: subject, predicate and perhaps an object.

    The result is short (``object/17 here:inPlace place/1``). The predicate is ``a`` or has a colon.
    """
    words = text.split()
    at = next((n for n, word in enumerate(words) if n and ":" in word), len(words))
    if at > 1 and words[at - 1] == "a":
        at -= 1
    iri = semantic_map.resolve("iri", " ".join(words[:at]) if at < len(words) else text)
    return " ".join([iri.removeprefix(semantic_map.base), *words[at:]])
