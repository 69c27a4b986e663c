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
from collections.abc import Iterable
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
    """Index of the names of a catalogue's categories, for lookup of ConceptNet terms."""

    def __init__(self, catalogue: Catalogue) -> None:
        self.groups: dict[str, tuple[Category, ...]] = {
            kind: tuple(c for c in catalogue.categories if c.kind == kind)
            for kind in ("object", "place", "supercategory")
        }
        self._index = {kind: _index(group) for kind, group in self.groups.items()}
        self._doubtful = _doubtful(self._index["object"])
        names = {c.iri: {" ".join(_words(n)) for n in _names(c)} for c in self.groups["place"]}
        #: Places whose name ends in -room.
        self.rooms = frozenset(p for p in names if any(n.endswith("room") for n in names[p]))
        #: "X outdoor" with the synonym X -> the place "X indoor" or "X room", or None.
        self.indoors = {
            place.iri: self.get(f"{bare} indoor", "place") or self.get(f"{bare} room", "place")
            for place in self.groups["place"]
            if (bare := place.label.removesuffix(" outdoor")) != place.label
            and bare in names[place.iri]
        }

    def get(self, term: str, kind: str) -> str | None:
        """IRI of the category of that kind with the name `term`, or None."""
        index = self._index[kind]
        return index.get(reduced(term)) or index.get(joined(term))

    def doubtful(self, term: str) -> str | None:
        """IRI of the object category that an ambiguous term may name, or None."""
        return self._doubtful.get(reduced(term))

    def terms(self, category: Category) -> tuple[str, ...]:
        """Query terms of a category: its names as words, without duplicates, sorted."""
        extra = [term for term in self._doubtful if self._doubtful[term] == category.iri]
        names = {joined(n): " ".join(_words(n)) for n in (*extra, *_names(category))}
        return tuple(sorted(filter(None, names.values())))


def _names(category: Category) -> Iterable[str]:
    return (category.label, *category.synonyms)


def _index(categories: Iterable[Category]) -> dict[str, str]:
    found: dict[str, str] = {}
    categories = tuple(categories)
    ranked = [(c.label, c.iri) for c in categories]
    ranked += [(name, c.iri) for c in categories for name in c.synonyms]
    for form in (
        reduced,
        joined,
    ):  # labels take precedence over synonyms, separate words over joined ones
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
