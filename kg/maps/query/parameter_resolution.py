"""Parameter resolution: names of categories, places and subjects of the map to IRIs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError, did_you_mean
from kg.model.records import PlaceRecord
from kg.rdf.quad_store import QuadStore


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
            return text if ":" in text else self.base + text
        return self.catalogue.find(text).iri if kind == "category" else self._place(text)

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
