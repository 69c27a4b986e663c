"""Parameter resolution: names of categories, places and subjects of the map to IRIs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.words.meaning import listed, understand
from kg.model import vocabulary as v
from kg.model.errors import (
    QueryParameterError,
    UndetectableError,
    UnknownCategoryError,
    did_you_mean,
)
from kg.model.records import PlaceRecord
from kg.rdf.quad_store import QuadStore

_LISTED: Final = 8  # labels in a message


@dataclass(frozen=True, slots=True)
class ParameterResolver:
    """Turns names into IRIs; `places` is read only where a name is no exact label."""

    engine: QuadStore
    base: str
    catalogue: Catalogue
    places: Callable[[], Iterable[PlaceRecord]]

    def resolve(self, kind: str, text: str) -> str:
        """The IRI that `text` means as a parameter of type ``iri``, ``category`` or ``place``.

        Raises UnknownCategoryError or QueryParameterError, which list the alternatives.
        """
        if kind == "iri":  # tables print the map's own things without its base: object/17
            return text if ":" in text else self._thing(text)
        return self._category(text) if kind == "category" else self._place(text)

    def _thing(self, text: str) -> str:
        """IRI of ``object/17``, or of the one thing with the label ``cup 17``."""
        if "/" in text or not text.strip():
            return self.base + text
        for label in dict.fromkeys((text, text.strip(), text.strip().casefold())):
            labelled = (None, NamedNode(v.RDFS_LABEL), Literal(label), v.MAP_GRAPH)
            # no iterator in a variable: an error would carry it into other threads
            found = sorted(
                quad.subject.value
                for quad in self.engine.quads_for_pattern(*labelled)
                if isinstance(quad.subject, NamedNode)
            )
            if len(found) == 1:
                return found[0]
            if found:
                raise QueryParameterError(
                    f"{len(found)} things have the label {label!r}: {', '.join(found[:5])}"
                )
        if len(text.split()) > 1:
            others = self._numbered(text) or (
                "a thing must be an IRI such as object/1, or a label, which "
                "`hereabouts ask MAP objects` lists"
            )
            raise QueryParameterError(f"nothing has the label {text[:60]!r}; {others}")
        return self.base + text

    def _numbered(self, text: str) -> str:
        """``there are: cup 9, cup 17`` for ``cup 99``; "" for a label of another form."""
        name, _, number = text.strip().rpartition(" ")
        category = self.catalogue.get(name, "object")
        if not number.isdigit() or category is None:
            return ""
        label = category.label
        named = self.engine.quads_for_pattern(None, NamedNode(v.RDFS_LABEL), None, v.MAP_GRAPH)
        labels = {quad.object.value for quad in named if isinstance(quad.object, Literal)}
        stems = {name.casefold(), label.casefold()}
        found = [one.rpartition(" ") for one in labels]
        found = [one for one in found if one[0].casefold() in stems and one[2].isdecimal()]
        if not found:
            return f"no {label} is in the map"
        shown = [
            "".join(one) for one in sorted(found, key=lambda one: (len(one[2]), one[2], one[0]))
        ]
        rest = f" and {len(shown) - _LISTED} more" if len(shown) > _LISTED else ""
        return f"there are: {', '.join(shown[:_LISTED])}{rest}"

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
        wanted = f"place {text}" if text.isdigit() else text
        exact = self._labelled(wanted)
        if exact is not None:
            return exact
        known = {place.iri: place.label for place in self.places()}
        for iri in (text, self.base + text):
            if iri in known:
                return iri
        named = [iri for iri, label in known.items() if label.lower() == wanted.lower()]
        numbered = f"{self.base}place/{text}"
        if not named and text.isdigit() and numbered in known:
            return numbered
        if len(named) == 1:
            return named[0]
        what = f"{len(named)} places are" if named else "no place is"
        hint = did_you_mean(text, known.values())
        raise QueryParameterError(
            f"{what} called {text!r}; there are: {', '.join(known.values()) or 'none'}{hint}"
        )

    def _labelled(self, label: str) -> str | None:
        """The one place of exactly that label, found without reading all places."""
        named = (NamedNode(v.RDFS_LABEL), Literal(label))
        found = [q.subject for q in self.engine.quads_for_pattern(None, *named, v.MAP_GRAPH)]
        if len(found) != 1 or not isinstance(found[0], NamedNode):
            return None
        is_place = Quad(found[0], v.RDF_TYPE, NamedNode(v.PLACE), v.MAP_GRAPH) in self.engine
        return found[0].value if is_place else None
