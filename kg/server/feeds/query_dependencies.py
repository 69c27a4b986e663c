"""Query dependencies: a superset of the facts that a query depends on, from its text.

A commit that touches none of them cannot change the query's answer; where the text does not tell
(a variable predicate, a path that steps over anything), every commit counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pyoxigraph import NamedNode, Quad
from rdflib import RDF, URIRef, Variable
from rdflib.paths import AlternativePath, InvPath, MulPath, SequencePath
from rdflib.plugins.sparql.algebra import translateQuery
from rdflib.plugins.sparql.parser import parseQuery
from rdflib.plugins.sparql.parserutils import CompValue

from kg import vocabulary as v

LONGEST = 4000  # characters a query may have to be looked into
DEEPEST = 12  # braces and parentheses, likewise: the parser recurses


@dataclass(frozen=True, slots=True)
class QueryDependencies:
    """Predicates in a query and, for rdf:type, the classes; or anything."""

    anything: bool = False
    predicates: frozenset[str] = field(default=frozenset())
    classes: frozenset[str] = field(default=frozenset())

    def concern(self, quads: Iterable[Quad]) -> bool:
        """Whether adding or removing `quads` may change the answer."""
        return self.anything or any(self._concerns(quad) for quad in quads)

    def _concerns(self, quad: Quad) -> bool:
        if quad.predicate.value in self.predicates:
            return True
        return (
            quad.predicate.value == v.RDF_TYPE
            and isinstance(quad.object, NamedNode)
            and quad.object.value in self.classes
        )


ANYTHING = QueryDependencies(anything=True)


def reads_of(sparql: str, base: str | None = None) -> QueryDependencies:
    """Dependencies of `sparql`, relative IRIs of `base`; `ANYTHING` where they are unknown."""
    if len(sparql) > LONGEST or _depth(sparql) > DEEPEST:
        return ANYTHING
    header = "" if base is None else f"BASE <{base}>\n"
    header += "".join(f"PREFIX {name}: <{iri}>\n" for name, iri in v.PREFIXES.items())
    try:
        query = translateQuery(parseQuery(header + sparql))
    except Exception:  # noqa: BLE001  rdflib's parser fails in many ways; the engine may read it
        return ANYTHING
    if query.algebra.name not in ("SelectQuery", "AskQuery"):
        return ANYTHING
    triples = list(_triples(query.algebra))
    predicates, classes = set[str](), set[str]()
    for _, predicate, target in triples:
        if predicate == RDF.type and isinstance(target, URIRef):
            classes.add(str(target))
            continue
        steps = _steps(predicate)
        if steps is None:
            return ANYTHING
        predicates |= steps
    return QueryDependencies(not triples, frozenset(predicates), frozenset(classes))


def _triples(part: object) -> Iterator[tuple[object, object, object]]:
    if isinstance(part, CompValue):
        for key, value in part.items():
            if key == "triples":
                yield from value
            else:
                yield from _triples(value)
    elif isinstance(part, list | tuple | set):
        for piece in part:
            yield from _triples(piece)


def _steps(predicate: object) -> set[str] | None:
    """The predicates of a path; None where it may step over any."""
    if isinstance(predicate, URIRef):
        return {str(predicate)}
    if isinstance(predicate, Variable):
        return None
    if isinstance(predicate, MulPath):
        # a path of length zero holds of every node there is
        return None if predicate.zero else _steps(predicate.path)
    if isinstance(predicate, InvPath):
        return _steps(predicate.arg)
    if isinstance(predicate, SequencePath | AlternativePath):
        parts = [_steps(piece) for piece in predicate.args]
        return None if None in parts else set[str]().union(*(p for p in parts if p))
    return None  # a negated path steps over nearly anything


def _depth(sparql: str) -> int:
    depth = deepest = 0
    for character in sparql:
        depth += (character in "({[") - (character in ")}]")
        deepest = max(deepest, depth)
    return deepest
