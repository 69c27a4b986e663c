"""Resolution of parameters: names to IRIs, and languages to one label for each thing.

A query gives one label for each thing, however many it has. The header of a query lists its label
variables: by ``labels: ontology category of class, map label of object``, ``?category`` is a label
of ``?class`` in the ontology's graph, and ``?label`` one of ``?object`` in the map's. For each, a
filter keeps the best label of the thing: one in a language asked for, in order of preference; else
one without a language, as the shipped ontologies have; else an English one; else any. Of several
the first by alphabet is kept. Language ranges and their lookup: RFC 4647, section 3.4.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.words.meaning import listed, understand
from kg.model import vocabulary as v
from kg.model.errors import (
    QueryError,
    QueryParameterError,
    UndetectableError,
    UnknownCategoryError,
    did_you_mean,
)
from kg.model.place_names import likely_kind, place_titles, titled
from kg.model.records import PlaceRecord, likeliest
from kg.model.usual_sizes import UNUSUAL, usual_sizes
from kg.rdf.literals import shown
from kg.rdf.quad_store import QuadStore, subcategories

_LISTED: Final = 8  # labels in a message
_SCHEME: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:\S*")
_ID: Final = re.compile(
    r"(?:object|place|door|observation|recording|search|agent|assertion|floor|area)/\S+"
)
_ARTICLE: Final = re.compile(r"(?:the|a|an) (?=.)")


def plain_label(text: str) -> str:
    """A label with single spaces and small letters, as labels are compared."""
    return " ".join(text.split()).casefold()


def without_article(text: str) -> str:
    """The same without an article at its beginning."""
    return _ARTICLE.sub("", plain_label(text), count=1)


@dataclass(frozen=True, slots=True)
class ParameterResolver:
    """Turns names into IRIs; `places` is read only where a name is no exact label."""

    engine: QuadStore
    base: str
    catalogue: Catalogue
    places: Callable[[], Iterable[PlaceRecord]]
    objects_of: Callable[[str], Sequence[str]]  # IRIs of the believed objects of a category (IRI)

    def resolve(self, kind: str, text: str) -> str:
        """The IRI that `text` means as a parameter of type ``iri``, ``category`` or ``place``.

        Of type ``thing`` only an id, an IRI or a label, without the other ways to name a thing;
        "" for any other text. Of type ``size`` the usual longest side of a category [m]. Raises
        UnknownCategoryError or QueryParameterError, which list the alternatives.
        """
        if kind == "category":
            return self._category(text)
        if kind == "size":
            category = self.catalogue.label(self._category(text))
            return str(usual_sizes().get(category, UNUSUAL).longest)
        if kind == "place":
            return self._place(text)
        found = self._identified(text) or self._labelled_thing(text)
        if not found and "/" in text and len(text.split()) == 1:
            found = self.base + text  # an id of another form than the map's own
        if found or kind == "thing":
            return found
        with suppress(QueryParameterError):
            return self._place(text)
        return self._only_one(text)

    def _identified(self, text: str) -> str:
        """IRI of ``object/17``, as tables print the map's own things, and of an IRI; else ""."""
        if _SCHEME.fullmatch(text):
            return text
        return self.base + text if _ID.fullmatch(text) or not text.strip() else ""

    def _labelled_thing(self, text: str) -> str:
        """IRI of the one thing with the label ``cup 17``; "" for none.

        Letters may be large or small, and an article may precede the label. Raises
        QueryParameterError for the label of several.
        """
        found = sorted(iri for iri, _ in self._labels(text) if self._is_thing(iri))
        for key in () if found else (plain_label, without_article):
            named = [iri for iri, label in self._labels() if key(label) == key(text)]
            found = sorted(filter(self._is_thing, named))
            if found:
                break
        if len(found) > 1:
            some = ", ".join(iri.removeprefix(self.base) for iri in found[:5])
            raise QueryParameterError(f"{len(found)} things have the label {text[:60]!r}: {some}")
        return found[0] if found else ""

    def _is_thing(self, iri: str) -> bool:
        """Whether an IRI is that of an object, a place or a door, or of another map."""
        kind = iri.removeprefix(self.base).partition("/")[0]
        return kind not in ("search", "recording", "agent", "observation")

    def _labels(self, label: str | None = None) -> list[tuple[str, str]]:
        """IRIs and labels of what the map has; with a `label`, of what has exactly that one."""
        exact = None if label is None else Literal(shown(label))
        named = (None, NamedNode(v.RDFS_LABEL), exact, v.MAP_GRAPH)
        # no iterator in a variable: an error would carry it into other threads
        return [
            (quad.subject.value, quad.object.value)
            for quad in self.engine.quads_for_pattern(*named)
            if isinstance(quad.subject, NamedNode) and isinstance(quad.object, Literal)
        ]

    def _only_one(self, text: str) -> str:
        """IRI of the only thing, or place, of a kind: ``the teddy bear``, ``kitchen``.

        Raises QueryParameterError where there are none or several.
        """
        if text.isascii() and text.isalpha() and self._exists(self.base + text):
            return self.base + text  # the robot
        words = without_article(text)
        if others := self._numbered(words):
            raise QueryParameterError(f"nothing has the label {text[:60]!r}; {others}")
        category = self.catalogue.get(words)
        if category is None:
            with suppress(UnknownCategoryError):
                meaning = understand(self.catalogue, words)
                if len(meaning.categories) == 1 and meaning.how != "spelling":
                    category = meaning.categories[0]
        if category is None:
            known = [label for iri, label in self._labels() if self._is_thing(iri)]
            raise QueryParameterError(
                f"nothing is called {text[:60]!r}; a thing must be an IRI such as object/1, a "
                "label, which `hereabouts ask MAP objects` lists, or a category that it alone has"
                f"{did_you_mean(text, (*known, *self._titles(list(self.places()))))}"
            )
        if category.kind == "place":
            return self._place(text)
        found = self.objects_of(category.iri)
        if len(found) == 1:
            return found[0]
        if not found:
            raise QueryParameterError(
                f"no {category.label} is in the map; give object/1 or a label"
            )
        labels = _some([self._label(iri) for iri in found])
        raise QueryParameterError(
            f"{len(found)} things are called {text[:60]!r}; give one of {labels}"
        )

    def _exists(self, iri: str) -> bool:
        facts = self.engine.quads_for_pattern(NamedNode(iri), None, None, v.MAP_GRAPH)
        return next(iter(facts), None) is not None

    def _label(self, iri: str) -> str:
        named = (NamedNode(iri), NamedNode(v.RDFS_LABEL), None, v.MAP_GRAPH)
        labels = [
            str(getattr(q.object, "value", "")) for q in self.engine.quads_for_pattern(*named)
        ]
        return min(labels, default=iri.removeprefix(self.base))

    def _numbered(self, text: str) -> str:
        """``there are: cup 9, cup 17`` for ``cup 99``; "" for a label of another form."""
        name, _, number = text.strip().rpartition(" ")
        category = self.catalogue.get(name, "object")
        if not number.isdigit() or category is None:
            return ""
        label = category.label
        stems = {name.casefold(), label.casefold()}
        found = [one.rpartition(" ") for one in {one for _, one in self._labels()}]
        found = [one for one in found if one[0].casefold() in stems and one[2].isdecimal()]
        if not found:
            return f"no {label} is in the map"
        found.sort(key=lambda one: (len(one[2]), one[2], one[0]))
        return f"there are: {_some([''.join(one) for one in found])}"

    def _category(self, text: str) -> str:
        """The category that a name means: of a place or an object, or of a word for objects."""
        known = self.catalogue.get(text)
        if known is not None:
            return known.iri
        meaning = understand(self.catalogue, text)
        if not meaning.categories:
            raise UndetectableError(
                f"no category includes '{meaning.text}': no detector here can see such things; "
                f"`hereabouts find MAP '{meaning.text}'` tells where they usually are"
            )
        if meaning.how == "spelling":  # a program that asks gets no guess
            labels = listed([one.label for one in meaning.categories])
            raise UnknownCategoryError(f"no category '{meaning.text}'; did you mean {labels}?")
        if len(meaning.categories) > 1:
            raise UnknownCategoryError(f"{meaning.note}; ask for one of them")
        return meaning.categories[0].iri

    def _place(self, text: str) -> str:
        """The place of a label, number or IRI, of a name in answers, or the only one of a kind."""
        wanted = f"place {text}" if text.isdigit() else text
        exact = self._labelled(wanted)
        if exact is not None:
            return exact
        places = list(self.places())
        known = {place.iri: place.label for place in places}
        for iri in (text, self.base + text):
            if iri in known:
                return iri
        named = [iri for iri, label in known.items() if label.lower() == wanted.lower()]
        numbered = f"{self.base}place/{text}"
        if not named and text.isdigit() and numbered in known:
            return numbered
        if len(named) == 1:
            return named[0]
        printed = self._printed(text, places)
        kinds = places_of_kind(self.engine, self.catalogue, places, text)
        if len(found := printed if len(printed) == 1 else [one.iri for one in kinds]) == 1:
            return found[0]
        some = _some([titled(place, self.catalogue.label) for place in kinds or places]) or "none"
        if kinds and not named:
            raise QueryParameterError(
                f"{len(kinds)} places have the category {text!r}; give one of {some}"
            )
        what = f"{len(named)} places are" if named else "no place is"
        hint = did_you_mean(text, (*known.values(), *self._titles(places)))
        raise QueryParameterError(f"{what} called {text[:60]!r}; there are: {some}{hint}")

    def _printed(self, text: str, places: Sequence[PlaceRecord]) -> list[str]:
        """IRIs of the places that answers call so, with or without "the"."""
        plain, label = without_article(text), self.catalogue.label
        return [
            place.iri
            for place, title in zip(places, self._titles(places), strict=True)
            if plain in map(plain_label, (place.label, title, titled(place, label)))
        ]

    def _titles(self, places: Sequence[PlaceRecord]) -> list[str]:
        """The titles of places in answers."""
        given = [(place.iri, place.label, place.beliefs) for place in places]
        return place_titles(given, self.catalogue.label)

    def _labelled(self, label: str) -> str | None:
        """The one place of exactly that label, found without reading all places."""
        found = [iri for iri, _ in self._labels(label)]
        if len(found) != 1:
            return None
        is_place = Quad(NamedNode(found[0]), v.RDF_TYPE, NamedNode(v.PLACE), v.MAP_GRAPH)
        return found[0] if is_place in self.engine else None


def places_of_kind(
    engine: QuadStore, catalogue: Catalogue, places: Sequence[PlaceRecord], text: str
) -> list[PlaceRecord]:
    """Places of a category, else of its kinds by name: a home office where there is no office."""
    words = without_article(text)
    known = catalogue.get(words, "place")
    if known is not None:
        kinds = subcategories(engine, known.iri)
        if believed := [one for one in places if likeliest(one.beliefs) in kinds]:
            return believed
    tail = f" {known.label if known else words}"
    return [one for one in places if likely_kind(one.beliefs, catalogue.label).endswith(tail)]


def _some(labels: Sequence[str]) -> str:
    """The first labels, and how many more there are."""
    rest = f" and {len(labels) - _LISTED} more" if len(labels) > _LISTED else ""
    return ", ".join(labels[:_LISTED]) + rest


MAX_LANGUAGES: Final = 8  # of one preference; each makes the filter longer
_HEADER: Final = re.compile(r"(ontology|map) (\w+) of (every )?(\w+)")
_RANGE: Final = re.compile(
    r"\s*(\*|[A-Za-z]{1,8}(?:-[A-Za-z0-9]{1,8})*)\s*(?:;\s*q\s*=\s*(\d(?:\.\d*)?)\s*)?"
)


@dataclass(frozen=True, slots=True)
class LabelColumn:
    """A variable of a query that is the label of another one, both without ``?``."""

    graph: str  # "ontology" or "map"
    label: str
    every: bool  # whether the query reads the labels of all things, not those of a few rows
    thing: str

    def filter(self, languages: Sequence[str]) -> str:
        """A filter for the group of the variables, which keeps the best label; on one line."""
        better, other = self._better(languages), self._labelled("_other")
        return f" FILTER(IF(BOUND(?{self.label}), NOT EXISTS {{ {other} {better} }}, true))"

    def minus(self, languages: Sequence[str]) -> str:
        """The same at the end of the group, for `every`: a join of all labels, not one a row."""
        both = "".join(
            f"{{ SELECT ?{self.thing} ?{self.label}{one} {{ {self._labelled(one)} }} }} "
            for one in ("", "_other")
        )
        return f" MINUS {{ {both}{self._better(languages)} }}"

    def _labelled(self, suffix: str = "") -> str:
        return f"GRAPH graph:{self.graph} {{ ?{self.thing} rdfs:label ?{self.label}{suffix} }}"

    def _better(self, languages: Sequence[str]) -> str:
        """A filter that the other label is the better one."""
        own, other = f"?{self.label}", f"?{self.label}_other"
        mine, its = _rank(own, languages), _rank(other, languages)
        return (
            f"FILTER({other} != {own} && ({its} < {mine} || "
            f"{its} = {mine} && (STR({other}) < STR({own}) || "
            f"STR({other}) = STR({own}) && LANG({other}) < LANG({own}))))"
        )


def label_columns(name: str, header: str) -> tuple[LabelColumn, ...]:
    """The columns in a header line of the query `name`; raises QueryError for another form."""
    columns = []
    for part in filter(None, (part.strip() for part in header.split(","))):
        match = _HEADER.fullmatch(part)
        if match is None:
            raise QueryError(
                f"{name}: labels must be 'ontology LABEL of THING' or 'map LABEL of THING', "
                f"got {part!r}"
            )
        graph, label, every, thing = match.groups()
        columns.append(LabelColumn(graph, label, every is not None, thing))
    return tuple(columns)


def preferred_languages(text: str) -> tuple[str, ...]:
    """Languages in order of preference, from text such as ``de`` or ``de-AT, fr;q=0.5``.

    The syntax is that of Accept-Language (RFC 9110, section 12.5.4); a language with a region is
    followed by the language alone. Raises QueryParameterError for text of another form.
    """
    weighed = []
    for part in filter(str.strip, text.split(",")):
        match = _RANGE.fullmatch(part)
        if match is None:
            raise QueryParameterError(
                f"a language is written de, en-GB or de, fr;q=0.5; got {text[:60]!r}"
            )
        weighed.append((match[1].lower(), float(match[2] or 1)))
    ordered = sorted((one for one in weighed if one[1] > 0), key=lambda one: -one[1])
    found: dict[str, None] = {}
    for language, _ in ordered[:MAX_LANGUAGES]:
        if language != "*":
            found |= dict.fromkeys((language, language.partition("-")[0]))
    return tuple(found)


def _rank(variable: str, languages: Sequence[str]) -> str:
    """SPARQL expression of the rank of a label; the lowest is the best."""
    tests = [f"LANGMATCHES(LANG({variable}), {Literal(one)})" for one in languages]
    tests += [f'LANG({variable}) = ""', f'LANGMATCHES(LANG({variable}), "en")']
    expression = str(len(tests))
    for rank, test in reversed([*enumerate(tests)]):
        expression = f"IF({test}, {rank}, {expression})"
    return expression
