"""Term matching: finds the category of a ConceptNet term.

ConceptNet 4 has lemmas without stop words ("live room", "dine table", "office build"), ConceptNet 5
mostly words ("living_room"), people use both, or joined words ("livingroom"). Labels, synonyms and
terms are normalised in the same way and then compared:

- NFKC normalisation and case folding; characters other than letters and digits become spaces;
- stop words are dropped;
- every word is reduced to its singular;
- words before the last one lose a final -ing, -ed and e, as in a lemma ("living room", "live
  room"); the last word keeps them, since "bedding" is no bed and "skiing" no ski;
- forms that still differ are compared without spaces ("living-room", "livingroom").
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Final

from kg.knowledge.ontology.catalogue import Catalogue, Category

_STOP_WORDS: Final = frozenset(
    (
        *("a", "an", "the", "of", "in", "on", "at", "to", "for", "and", "or", "with", "some"),
        *("any", "my", "your", "his", "her", "its", "our", "their"),
    )
)
#: Nouns that a lemmatiser reduces as verbs.
_HEADS: Final = {"build": "building"}
#: Ambiguous names of a category; each counts half (`DOUBTFUL_SHARE`).
ALSO_CALLED: Final = {"notebook": "laptop"}
#: Labels of wider kinds of places in places.ttl: the last is of buildings seen from outside.
_INDOORS: Final = "indoor place"
_OUTDOORS: Final = "outdoor place"
_EXTERIOR: Final = "building exterior"
#: Labels of superclasses of places that do not say what a place is for.
_NO_USE: Final = frozenset({_INDOORS, _OUTDOORS, _EXTERIOR, "place", "space"})
_PLURALS: Final = (
    (re.compile(r"(?<=i)ves$"), "fe"),
    (re.compile(r"(?<=[al])ves$"), "f"),
    (re.compile(r"(?<=..)ies$"), "y"),
    (re.compile(r"(?<=ch|sh|ss)es$"), ""),
    (re.compile(r"(?<=x)es$"), ""),
    (re.compile(r"(?<=o)es$"), ""),
    (re.compile(r"(?<=..)(?<![siu])s$"), ""),
)


@lru_cache(maxsize=20_000)
def reduced(term: str) -> str:
    """Normalised words of a term, for comparison; empty for a term of stop words."""
    words = [_singular(word) for word in _words(term) if word not in _STOP_WORDS]
    if not words:
        return ""
    head = _HEADS.get(words[-1], words[-1])
    return " ".join([*(_stem(word) for word in words[:-1]), head])


def joined(term: str) -> str:
    """A term's words joined without spaces, not normalised further."""
    return "".join(_words(term))


def _words(term: str) -> list[str]:
    text = unicodedata.normalize("NFKC", term).casefold().replace("'s ", " ").replace("'", "")
    return "".join(c if c.isalnum() else " " for c in text).split()


def _singular(word: str) -> str:
    for plural, ending in _PLURALS:
        if plural.search(word):
            return plural.sub(ending, word)
    return word


def _stem(word: str) -> str:
    stem = re.sub(r"(ing|ed)$", "", word)
    if len(stem) < 3 or not re.search("[aeiouy]", stem):
        stem = word
    if stem != word and stem[-1] == stem[-2] and stem[-1] not in "lsz":
        stem = stem[:-1]
    return stem.removesuffix("e") if len(stem) > 3 else stem


class TermMatcher:
    """Index of the names of a catalogue's categories, for lookup of ConceptNet terms.

    Args:
        catalogue: The categories.
        kinds: IRI of a place category -> labels of the wider kinds of places that it is of.
    """

    def __init__(
        self, catalogue: Catalogue, kinds: Mapping[str, frozenset[str]] | None = None
    ) -> None:
        self.kinds = kinds or {}
        self.groups: dict[str, tuple[Category, ...]] = {
            kind: tuple(c for c in catalogue.categories if c.kind == kind)
            for kind in ("object", "place", "supercategory")
        }
        self._index = {kind: _index(group) for kind, group in self.groups.items()}
        self._doubtful = _doubtful(self._index["object"])
        labels = {c.iri: reduced(c.label).split() for group in self.groups.values() for c in group}
        self._heads = {iri: words[-1] for iri, words in labels.items() if len(words) > 1}
        self._modifiers = {iri: frozenset(words[:-1]) for iri, words in labels.items()}
        #: A place seen from outside -> the place inside of it, or None if no category is that.
        self.indoors = {
            place.iri: self._inside(place)
            for place in self.groups["place"]
            if _EXTERIOR in self.kinds.get(place.iri, ())
        }

    def get(self, term: str, kind: str) -> str | None:
        """IRI of the category of that kind with the name `term`, or None."""
        index = self._index[kind]
        return index.get(reduced(term)) or index.get(joined(term))

    def generic(self, term: str, category: str) -> bool:
        """Whether a term is a wider word that also names a category: "table" for a dining table.

        It is the head of the label, so the label names a kind of what the term means.
        """
        return reduced(term) == self._heads.get(category)

    def shares_modifier(self, category: str, place: str) -> bool:
        """Whether label and place are modified by one word, as dining table and dining room."""
        first = self._modifiers.get(category, frozenset())
        return bool(first & self._modifiers.get(place, frozenset()))

    def is_indoors(self, place: str) -> bool:
        """Whether a place is inside of a building."""
        return _INDOORS in self.kinds.get(place, ())

    def is_outdoors(self, place: str) -> bool:
        """Whether a place is in the open."""
        return _OUTDOORS in self.kinds.get(place, ())

    def uses(self, place: str) -> frozenset[str]:
        """Labels of the wider kinds of a place that say what it is for: home, workplace, shop."""
        return self.kinds.get(place, frozenset()) - _NO_USE

    def doubtful(self, term: str) -> str | None:
        """IRI of the object category that an ambiguous term may name, or None."""
        return self._doubtful.get(reduced(term))

    def _inside(self, place: Category) -> str | None:
        bare = place.label.removesuffix(" outdoor").removesuffix(" building")
        found = (self.get(f"{bare}{inside}", "place") for inside in (" indoor", " room", ""))
        return next((iri for iri in found if iri not in (None, place.iri)), None)

    def terms(self, category: Category) -> tuple[str, ...]:
        """Query terms of a category: its names as words, without duplicates, sorted."""
        extra = [term for term in self._doubtful if self._doubtful[term] == category.iri]
        names = {
            joined(n): " ".join(_words(n)) for n in (*extra, category.label, *category.synonyms)
        }
        return tuple(sorted(filter(None, names.values())))


def _index(categories: Iterable[Category]) -> dict[str, str]:
    found: dict[str, str] = {}
    categories = tuple(categories)
    ranked = [(c.label, c.iri) for c in categories]
    ranked += [(name, c.iri) for c in categories for name in c.synonyms]
    # labels take precedence over synonyms, separate words over joined ones
    for form in (reduced, joined):
        for name, iri in ranked:
            if key := form(name):
                found.setdefault(key, iri)
    return found


def _doubtful(objects: dict[str, str]) -> dict[str, str]:
    return {
        reduced(term): objects[reduced(label)]
        for term, label in ALSO_CALLED.items()
        if reduced(label) in objects and reduced(term) not in objects
    }
