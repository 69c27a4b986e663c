"""OWL 2 DL profile checks that need no reasoner.

The OWLAPI checks the rest of the profile (docs/how-to/protege.md). `kg.knowledge.ontology.lint`
checks the kinds of properties and their declarations.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.declared_terms import like_declared
from kg.model import vocabulary as v
from kg.rdf.findings import Finding

_BETWEEN_CLASSES: Final = {
    v.RDFS_SUB_CLASS_OF,
    v.OWL_EQUIVALENT_CLASS,
    v.OWL_DISJOINT_WITH,
}
_RESERVED: Final = tuple(v.PREFIXES[name] for name in ("rdf", "rdfs", "owl", "xsd"))
_DECLARING: Final = {
    v.OWL_CLASS,
    v.OWL_OBJECT_PROPERTY,
    v.OWL_DATATYPE_PROPERTY,
    v.OWL_ANNOTATION_PROPERTY,
    v.RDFS_DATATYPE,
}
_DECIMAL = r"[+-]?(\d+(\.\d*)?|\.\d+)"
_DOUBLE = rf"{_DECIMAL}([eE][+-]?\d+)?|[+-]?INF|NaN"
_LEXICAL: Final = {
    v.XSD + "double": re.compile(_DOUBLE),
    v.XSD + "float": re.compile(_DOUBLE),
    v.XSD + "decimal": re.compile(_DECIMAL),
    v.XSD + "integer": re.compile(r"[+-]?\d+"),
    v.XSD + "boolean": re.compile("true|false|0|1"),
}


def owl_dl_findings(quads: Iterable[Quad]) -> list[Finding]:
    """Violations of the profile: undeclared classes, terms that are both class and datatype,
    redeclared terms of OWL, and literals with an invalid lexical form."""
    quads = tuple(quads)
    kinds: dict[str, set[str]] = defaultdict(set)
    for quad in quads:
        if quad.predicate == v.RDF_TYPE and isinstance(quad.subject, NamedNode):
            kinds[quad.subject.value].add(getattr(quad.object, "value", ""))
    found = [*_undeclared_classes(quads, kinds), *_declared_wrongly(kinds), *_ill_typed(quads)]
    found += _restricted_annotations(quads, kinds)
    return sorted(set(found))


def _undeclared_classes(quads: Iterable[Quad], kinds: dict[str, set[str]]) -> Iterator[Finding]:
    for quad in quads:
        if quad.predicate.value not in _BETWEEN_CLASSES:
            continue
        for term in (quad.subject, quad.object):
            if (
                isinstance(term, NamedNode)
                and v.OWL_CLASS not in kinds.get(term.value, ())
                and term.value not in (v.OWL_THING, v.OWL_NOTHING)
            ):
                message = "is used as a class and not declared one"
                classes = {iri for iri, types in kinds.items() if v.OWL_CLASS in types}
                yield Finding(term.value, message + like_declared(term.value, classes))


def _restricted_annotations(quads: Iterable[Quad], kinds: dict[str, set[str]]) -> Iterator[Finding]:
    """Restrictions on annotation properties; OWL 2 DL has them on object and data properties."""
    restricted: dict[object, str] = {
        q.subject: q.object.value
        for q in quads
        if q.predicate.value == v.OWL_ON_PROPERTY
        and isinstance(q.object, NamedNode)
        and v.OWL_ANNOTATION_PROPERTY in kinds.get(q.object.value, ())
    }
    for quad in quads:
        if quad.object in restricted and isinstance(quad.subject, NamedNode):
            prop = restricted[quad.object].replace(v.HERE, "here:")
            message = (
                f"has a restriction on {prop}, an annotation property; "
                f"relate the classes by {prop} itself"
            )
            yield Finding(quad.subject.value, message, quad.predicate.value)


def _declared_wrongly(kinds: dict[str, set[str]]) -> Iterator[Finding]:
    for iri, types in kinds.items():
        if {v.OWL_CLASS, v.RDFS_DATATYPE} <= types:
            yield Finding(focus=iri, message="is a class and a datatype")
        if iri.startswith(_RESERVED) and types & _DECLARING and iri not in _ALLOWED:
            yield Finding(focus=iri, message="is a term of OWL itself and cannot be declared anew")


#: built-in terms that editors declare redundantly
_ALLOWED: Final = (
    {v.OWL_THING, v.OWL_NOTHING}
    | {
        v.PREFIXES["rdfs"] + name
        for name in ("label", "comment", "seeAlso", "isDefinedBy", "Literal")
    }
    | {v.PREFIXES["owl"] + name for name in ("versionInfo", "deprecated")}
    | {v.XSD + name for name in ("string", "double", "integer", "dateTime", "boolean", "decimal")}
)


def _ill_typed(quads: Iterable[Quad]) -> Iterator[Finding]:
    for quad in quads:
        value = quad.object
        if not isinstance(value, Literal):
            continue
        lexical = _LEXICAL.get(value.datatype.value)
        if lexical is not None and not lexical.fullmatch(value.value):
            kind = value.datatype.value.replace(v.XSD, "xsd:")
            yield Finding(
                focus=getattr(quad.subject, "value", ""),
                message=f"holds a text that is no {kind}",
                path=quad.predicate.value,
                value=value.value,
            )
