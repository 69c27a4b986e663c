"""An OWL 2 DL document (OWL 2 Mapping to RDF Graphs, sections 3.1 and 5) of a map in one graph.

It has one ontology header and no imports, since it contains the imported ontologies. Every class,
property and datatype in use is declared. Binary data is hexadecimal, since HermiT refuses
xsd:base64Binary.
"""

from __future__ import annotations

import base64
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from kg.knowledge.ontology.import_closure import headers_of
from kg.model import vocabulary as v

_KEPT: Final = {v.DCT_LICENSE, v.OWL_VERSION_INFO}  # of the merged headers
_BUILT_IN: Final = tuple(v.PREFIXES[name] for name in ("rdf", "rdfs", "owl", "xsd"))
_CLASSES: Final = {v.OWL_CLASS, v.RDFS_DATATYPE}
_PROPERTIES: Final = {v.OWL_OBJECT_PROPERTY, v.OWL_DATATYPE_PROPERTY, v.OWL_ANNOTATION_PROPERTY}
#: datatypes of OWL 2 (Structural Specification, section 4) that reasoners support
_DATATYPES: Final = {v.PREFIXES["rdf"] + "PlainLiteral", v.PREFIXES["rdf"] + "langString"} | {
    v.XSD + name
    for name in (
        *("string", "boolean", "decimal", "integer", "double", "float", "dateTime"),
        *("dateTimeStamp", "hexBinary", "anyURI", "nonNegativeInteger", "long", "int"),
    )
}

#: datatypes of XML Schema that are none of OWL 2; OWL tools declare them
_UNDECLARED: Final = {
    v.XSD + name
    for name in (
        *("date", "time", "duration", "dayTimeDuration", "yearMonthDuration"),
        *("gYear", "gYearMonth", "gMonth", "gMonthDay", "gDay"),
    )
}


def owl_document(triples: Iterable[Triple], iri: str, label: str) -> list[Triple]:
    """The triples of a map and its ontologies as one ontology named `iri`, in their order."""
    merged = with_one_header(map(_in_hexadecimal, triples), iri, label)
    whole = [*merged, *_declarations(merged)]
    return list(dict.fromkeys([*whole, *_individuals(whole)]))


def with_one_header(triples: Iterable[Triple], iri: str, label: str) -> list[Triple]:
    """The triples with one owl:Ontology, `iri`, instead of theirs, and without imports."""
    triples = tuple(triples)
    parts = headers_of(triples)
    own = NamedNode(iri)
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, NamedNode(v.OWL_ONTOLOGY)),
        (v.RDFS_LABEL, Literal(label)),
        (v.RDFS_COMMENT, Literal("The facts of the map when this file was written.")),
    ]
    header = [Triple(own, NamedNode(predicate), value) for predicate, value in facts]
    body = []
    for triple in triples:
        if getattr(triple.subject, "value", "") not in parts:
            body.append(triple)
        elif triple.predicate.value in _KEPT:
            header.append(Triple(own, triple.predicate, triple.object))
    return [*dict.fromkeys(header), *body]


def _in_hexadecimal(triple: Triple) -> Triple:
    """The triple with xsd:hexBinary instead of xsd:base64Binary, as datatype and as term."""
    value = triple.object
    if value == v.XSD_BASE64:
        return Triple(triple.subject, triple.predicate, v.XSD_HEX)
    if not isinstance(value, Literal) or value.datatype != v.XSD_BASE64:
        return triple
    try:
        text = base64.b64decode(value.value).hex().upper()
    except ValueError:
        return triple
    return Triple(triple.subject, triple.predicate, Literal(text, datatype=v.XSD_HEX))


def _declarations(triples: list[Triple]) -> Iterator[Triple]:
    """Declarations of the classes, properties and datatypes that have none."""
    declared: dict[str, set[str]] = defaultdict(set)
    values: dict[str, list[object]] = defaultdict(list)
    for triple in triples:
        if triple.predicate != v.RDF_TYPE:
            values[triple.predicate.value].append(triple.object)
        elif isinstance(triple.subject, NamedNode) and isinstance(triple.object, NamedNode):
            declared[triple.subject.value].add(triple.object.value)
    used = {cls for kinds in declared.values() for cls in kinds}
    classes = {cls for cls in used if not declared.get(cls, set()) & _CLASSES}
    yield from _typed(classes, v.OWL_CLASS)
    for predicate, found in values.items():
        if not declared.get(predicate, set()) & _PROPERTIES:
            yield from _typed({predicate}, _kind(found, declared))
    literals = (value for found in values.values() for value in found)
    kinds = {value.datatype.value for value in literals if isinstance(value, Literal)}
    kinds -= declared.keys()
    yield from _typed(kinds, v.RDFS_DATATYPE)
    for iri in sorted(kinds & _UNDECLARED):
        yield Triple(NamedNode(iri), v.RDF_TYPE, NamedNode(v.RDFS_DATATYPE))


def _individuals(triples: list[Triple]) -> Iterator[Triple]:
    """Declarations of the individuals, as OWL tools write them.

    These are the things with a class of the document, and those that its properties are about.
    """
    kinds: dict[str, set[str]] = defaultdict(set)
    for triple in triples:
        if triple.predicate == v.RDF_TYPE and isinstance(triple.subject, NamedNode):
            kinds[getattr(triple.object, "value", "")].add(triple.subject.value)
    found = {iri for cls in kinds[v.OWL_CLASS] for iri in kinds.get(cls, ())}
    relations = kinds[v.OWL_OBJECT_PROPERTY]
    facts = relations | kinds[v.OWL_DATATYPE_PROPERTY]
    for triple in triples:
        predicate, ends = triple.predicate.value, (triple.subject, triple.object)
        about = ends if predicate in relations else ends[:1] if predicate in facts else ()
        found.update(end.value for end in about if isinstance(end, NamedNode))
    yield from _typed(found, v.OWL_NAMED_INDIVIDUAL)


def _kind(values: Iterable[object], declared: dict[str, set[str]]) -> str:
    """Kind of a property with such values; annotation if reasoners do not support them."""
    values = tuple(values)
    if all(isinstance(value, Literal) and value.datatype.value in _DATATYPES for value in values):
        return v.OWL_DATATYPE_PROPERTY
    things = all(isinstance(value, NamedNode | BlankNode) for value in values)
    names = (value.value for value in values if isinstance(value, NamedNode))
    if things and not any(declared.get(name, set()) & _CLASSES for name in names):
        return v.OWL_OBJECT_PROPERTY
    return v.OWL_ANNOTATION_PROPERTY


def _typed(iris: Iterable[str], kind: str) -> Iterator[Triple]:
    for iri in sorted(iris):
        if not iri.startswith(_BUILT_IN):
            yield Triple(NamedNode(iri), v.RDF_TYPE, NamedNode(kind))
