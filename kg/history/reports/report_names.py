"""Names in reports: objects by their labels, places by their titles, categories by their labels.

They are the names that answers print, so that the history of a map reads as its answers do.
"""

from __future__ import annotations

import re
from functools import cached_property
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg.history.map_state import Categories
from kg.history.timestamps import brief, word
from kg.model import vocabulary as v
from kg.model.place_names import indefinite, plain_place, spoken_titles
from kg.rdf.quad_store import QuadStore, Term

_LOCAL: Final = re.compile(r"(object|place|observation|recording|search)/([^/]+)(?:/belief/(.+))?")
_IRI: Final = re.compile(r"https?://[^\s<>\"]+")
_VERBS: Final = {
    v.IN_PLACE: "is in",
    v.ON: "is on",
    v.INSIDE: "is inside",
    v.RDFS_LABEL: "is called",
}


class Names:
    """Names of the things of the map in `engine`, whose base IRI is `base`, as answers have them.

    A term that nobody named is short: ``object 9``, ``here:markedBy``.
    """

    def __init__(self, engine: QuadStore, base: str) -> None:
        self._engine, self._base = engine, base
        self._categories = Categories(engine, frozenset())

    def __call__(self, term: Term) -> str:
        """``cup 9``, ``the kitchen``, ``sports ball``; of a literal its text."""
        if not isinstance(term, NamedNode):
            return brief(term, self._base)
        local = _LOCAL.fullmatch(term.value.removeprefix(self._base))
        if local is None or not term.value.startswith(self._base):
            return self._labels(term, v.ONTOLOGY_GRAPH) or brief(term, self._base)
        kind, number, belief = local.groups()
        thing = NamedNode(f"{self._base}{kind}/{number}")
        if belief:
            return f"the belief that {self._called(thing, kind, number)} is {belief}"
        if kind == "observation":
            return f"the best view of {self(NamedNode(f'{self._base}object/{number}'))}"
        return self._called(thing, kind, number)

    def fact(self, subject: Term, predicate: Term, value: Term | None) -> str:
        """A fact as a sentence: ``cup 9 is in the kitchen``, ``cup 9: existence 0.9``."""
        name, known = self(subject), "" if value is None else self(value)
        if predicate == v.RDF_TYPE:
            # "the kitchen is a kitchen" says nothing: a place has its label here
            is_place = getattr(subject, "value", "") in self._titles
            label = self._labels(subject, v.MAP_GRAPH) if is_place else ""
            if known == name != "robot":  # a category that a person named
                return f"{name} has a name of its own"
            return f"{label or name} is {indefinite(known)}" if known else f"the kind of {name}"
        verb = _VERBS.get(getattr(predicate, "value", ""), "")
        return f"{name} {verb} {known}" if verb and known else f"{name}: {word(predicate)} {known}"

    def text(self, text: str) -> str:
        """A text with names in place of the IRIs in it."""
        return _IRI.sub(lambda found: self(NamedNode(found[0])), text)

    def _called(self, thing: NamedNode, kind: str, number: str) -> str:
        if kind == "recording":
            return number
        name = self._titles.get(thing.value) or self._labels(thing, v.MAP_GRAPH)
        return name or f"{kind} {number}"

    def _labels(self, thing: Term, graph: NamedNode) -> str:
        """The label of a thing, or of a category in the graph of the ontology; "" without one."""
        labels = [
            x.value for x in self._values(thing, v.RDFS_LABEL, graph) if isinstance(x, Literal)
        ]
        if labels and graph == v.ONTOLOGY_GRAPH and isinstance(thing, NamedNode):
            return plain_place(self._categories.label(thing.value))
        return min(labels, default="")

    @cached_property
    def _titles(self) -> dict[str, str]:
        """Titles of places with their articles, by IRI."""
        found = self._engine.quads_for_pattern(None, v.RDF_TYPE, NamedNode(v.PLACE), v.MAP_GRAPH)
        iris = sorted({q.subject.value for q in found if isinstance(q.subject, NamedNode)})
        named = [
            (iri, self._labels(NamedNode(iri), v.MAP_GRAPH), self._beliefs(iri)) for iri in iris
        ]
        return spoken_titles(named, self._categories.label, self._is_kind)

    def _is_kind(self, noun: str) -> bool:
        """Whether a word is a kind of place, or a room."""
        kinds = (Literal(noun), Literal(noun, language="en"))
        return noun == "room" or any(
            [*self._engine.quads_for_pattern(None, NamedNode(v.RDFS_LABEL), one, v.ONTOLOGY_GRAPH)]
            for one in kinds
        )

    def _beliefs(self, place: str) -> dict[str, float]:
        beliefs = dict[str, float]()
        for node in self._values(NamedNode(place), v.HAS_BELIEF):
            kinds, numbers = self._values(node, v.OF_CATEGORY), self._values(node, v.BELIEF)
            for kind, number in zip(kinds, numbers, strict=False):
                if isinstance(kind, NamedNode) and isinstance(number, Literal):
                    beliefs[kind.value] = float(number.value)
        return beliefs

    def _values(self, subject: Term, predicate: str, graph: NamedNode = v.MAP_GRAPH) -> list[Term]:
        if not isinstance(subject, NamedNode):
            return []
        found = self._engine.quads_for_pattern(subject, NamedNode(predicate), None, graph)
        return [quad.object for quad in found]
