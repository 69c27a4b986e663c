"""SHACL validation by pyshacl.

rdflib and pyshacl take 0.3 s to import, so callers import this module inside of functions.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from functools import cache, lru_cache
from pathlib import Path

import pyoxigraph
import rdflib
from pyshacl import validate as pyshacl_validate
from rdflib.term import Node

from kg.model import vocabulary as v
from kg.model.errors import OntologyError, ShapeError
from kg.rdf.findings import Finding

#: beginnings of IRIs that pyshacl accepts as focus nodes; it reads others as prefixed names
_PLAIN = ("http:", "https:", "urn:", "file:")

_PROPERTY = rdflib.SH.property
_TARGETS = (rdflib.SH.targetClass, rdflib.SH.targetSubjectsOf, rdflib.SH.targetObjectsOf)


def _is_not_ill_typed(record: logging.LogRecord) -> bool:
    return not str(record.msg).startswith("Failed to convert Literal")


# an ill-typed literal is a finding; rdflib also logs a traceback for each
logging.getLogger("rdflib.term").addFilter(_is_not_ill_typed)


class Shapes:
    """A file of shapes, read once."""

    def __init__(self, file: Path) -> None:
        """Raises OntologyError where the shapes do not parse."""
        self._file = file
        try:
            self._graph = rdflib.Graph().parse(file, format="turtle")
        except (SyntaxError, OSError) as error:
            raise OntologyError(f"{file}: {str(error).splitlines()[0]}") from None
        self._predicates = {
            str(predicate) for kind in _TARGETS[1:] for predicate in self._graph.objects(None, kind)
        }
        _spread_targets(self._graph)

    def may_target(self, facts: Iterable[pyoxigraph.Quad]) -> bool:
        """Whether a shape may target the subject of `facts`: by its class or a property.

        Most subjects that a document adds beside the map's own things are of no shape.
        """
        return any(
            q.predicate == v.RDF_TYPE or q.predicate.value in self._predicates for q in facts
        )

    def validate(
        self, quads: Iterable[pyoxigraph.Quad], focus: Iterable[str] | None = None
    ) -> list[Finding]:
        """Validate quads of all graphs against the shapes; nothing is inferred or fetched.

        `focus` has the IRIs of the subjects to validate. Where one of them looks like a prefixed
        name, all subjects are validated. Raises OntologyError for invalid shapes and ShapeError for
        values without an order.
        """
        data, term = rdflib.Graph(), cache(as_rdflib)  # most terms are in several quads
        for q in quads:
            data.add((term(q.subject), term(q.predicate), term(q.object)))
        names = None if focus is None else list(focus)
        if names is not None and not all(name.lower().startswith(_PLAIN) for name in names):
            names = None
        try:
            _, results, text = pyshacl_validate(
                data,
                shacl_graph=self._graph,
                inference="none",
                do_owl_imports=False,
                inplace=True,
                focus_nodes=names,
            )
        except TypeError:  # pyshacl compares values that have no order
            raise ShapeError(
                "a time or number cannot be compared with the others of its subject: "
                "times of the years 1 to 9999 work"
            ) from None
        if not isinstance(results, rdflib.Graph):
            raise OntologyError(f"{self._file}: {text}")
        is_result = (rdflib.RDF.type, rdflib.URIRef(v.SH_RESULT))
        parts = set(results.objects(None, rdflib.URIRef(v.SH_DETAIL)))  # of other results
        found = set(results.subjects(*is_result)) - parts
        return sorted({_finding(results, result) for result in found})


def _spread_targets(shapes: rdflib.Graph) -> None:
    """Give the property shapes of a node shape its targets, and take them out of it.

    The findings are the same. pyshacl checks a property shape of a node shape for one focus node at
    a time, which takes several times as long as for all of them at once.
    """
    for node, _, part in tuple(shapes.triples((None, _PROPERTY, None))):
        targets = [(kind, to) for kind, to in shapes.predicate_objects(node) if kind in _TARGETS]
        if targets and (None, None, node) not in shapes:  # other shapes refer to it as a whole
            shapes.remove((node, _PROPERTY, part))
            for kind, target in targets:
                shapes.add((part, kind, target))


def validate(quads: Iterable[pyoxigraph.Quad], shapes: Path) -> list[Finding]:
    """Validate quads against the shapes in a file, as `Shapes.validate`."""
    return _shapes(shapes, shapes.stat().st_mtime_ns).validate(quads)


@lru_cache(maxsize=1)
def _shapes(file: Path, _modified: int) -> Shapes:
    return Shapes(file)


def _finding(results: rdflib.Graph, result: Node) -> Finding:
    def value_of(predicate: str) -> str:
        term = results.value(result, rdflib.URIRef(predicate))
        return "" if term is None or isinstance(term, rdflib.BNode) else str(term)

    focus = results.value(result, rdflib.URIRef(v.SH_FOCUS_NODE))
    return Finding(
        focus=str(focus),
        message=value_of(v.SH_RESULT_MESSAGE),
        path=value_of(v.SH_RESULT_PATH),
        value=value_of(v.SH_VALUE),
        severity="warning" if value_of(v.SH_RESULT_SEVERITY) == v.SH_WARNING else "violation",
    )


def as_rdflib(term: object) -> Node:
    """The rdflib term with the same lexical form (NaN stays NaN)."""
    if isinstance(term, pyoxigraph.NamedNode):
        return rdflib.URIRef(term.value)
    if isinstance(term, pyoxigraph.BlankNode):
        return rdflib.BNode(term.value)
    if isinstance(term, pyoxigraph.Literal):
        if term.language:
            return rdflib.Literal(term.value, lang=term.language)
        datatype = rdflib.URIRef(term.datatype.value)
        return rdflib.Literal(term.value, datatype=datatype, normalize=False)
    raise OntologyError(f"a quoted triple cannot be checked: {term}")
