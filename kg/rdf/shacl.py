"""SHACL validation by pyshacl.

rdflib and pyshacl take 0.3 s to import, so callers import this module inside of functions.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import pyoxigraph
import rdflib
from pyshacl import validate as pyshacl_validate
from rdflib.term import Node

from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.rdf.findings import Finding

#: beginnings of IRIs that pyshacl accepts as focus nodes; it reads others as prefixed names
_PLAIN = ("http:", "https:", "urn:", "file:")


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
            str(predicate)
            for kind in (v.SH_TARGET_SUBJECTS_OF, v.SH_TARGET_OBJECTS_OF)
            for predicate in self._graph.objects(None, rdflib.URIRef(kind))
        }

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
        name, all subjects are validated. Raises OntologyError for invalid shapes.
        """
        data = rdflib.Graph()
        for q in quads:
            data.add((as_rdflib(q.subject), as_rdflib(q.predicate), as_rdflib(q.object)))
        names = None if focus is None else list(focus)
        if names is not None and not all(name.lower().startswith(_PLAIN) for name in names):
            names = None
        _, results, text = pyshacl_validate(
            data,
            shacl_graph=self._graph,
            inference="none",
            do_owl_imports=False,
            inplace=True,
            focus_nodes=names,
        )
        if not isinstance(results, rdflib.Graph):
            raise OntologyError(f"{self._file}: {text}")
        is_result = (rdflib.RDF.type, rdflib.URIRef(v.SH_RESULT))
        parts = set(results.objects(None, rdflib.URIRef(v.SH_DETAIL)))  # of other results
        found = set(results.subjects(*is_result)) - parts
        return sorted({_finding(results, result) for result in found})


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
