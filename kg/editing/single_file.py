"""A map's ontology as one file that OWL editors open."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pyoxigraph import Literal, NamedNode, RdfFormat, Triple, serialize

from kg import vocabulary as v
from kg.characters import in_xml
from kg.editing.imports import headers
from kg.errors import OntologyError
from kg.export import write_atomically
from kg.semantic_map import SemanticMap

_FORMATS: Final = {
    ".ttl": RdfFormat.TURTLE,
    ".owl": RdfFormat.RDF_XML,
    ".rdf": RdfFormat.RDF_XML,
    ".nt": RdfFormat.N_TRIPLES,
}
_KEPT: Final = {v.DCT_LICENSE, v.OWL_VERSION_INFO}  # of the headers that became one


def export_ontology(semantic_map: SemanticMap, path: Path) -> int:
    """Write the map's ontology to `path`, imports included; returns how many triples.

    OWL wants one header a file: that of the map's ontology, named after the map. Raises
    OntologyError where the ending is not .ttl, .owl, .rdf or .nt; GraphError where it cannot be
    written.
    """
    form = _FORMATS.get(path.suffix.lower())
    if form is None:
        raise OntologyError(
            f"cannot tell the format of {path.name!r} from its ending; use {', '.join(_FORMATS)}"
        )
    triples = sorted(set(_with_one_header(semantic_map)), key=_order)
    text = serialize(triples, format=form, prefixes=v.PREFIXES)
    if form == RdfFormat.RDF_XML:
        text = in_xml(text or b"")
    write_atomically(path, (text or b"").decode("utf-8"))
    return len(triples)


def _with_one_header(semantic_map: SemanticMap) -> list[Triple]:
    quads = semantic_map.ontology()
    parts = headers(quads)
    own = NamedNode(semantic_map.base + "ontology")
    said: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE, NamedNode(v.OWL_ONTOLOGY)),
        (v.RDFS_LABEL, Literal(f"ontology of {semantic_map.title}")),
        (v.RDFS_COMMENT, Literal("What the map knew about the world when this was written.")),
    ]
    header = [Triple(own, NamedNode(predicate), value) for predicate, value in said]
    body = []
    for quad in quads:
        if getattr(quad.subject, "value", "") not in parts:
            body.append(quad.triple)
        elif quad.predicate.value in _KEPT:
            header.append(Triple(own, quad.predicate, quad.object))
    return [*header, *body]


def _order(triple: Triple) -> tuple[bool, str, bool, str, str]:
    subject = str(triple.subject)
    is_type = triple.predicate.value == v.RDF_TYPE
    return subject.startswith("_:"), subject, not is_type, str(triple.predicate), str(triple.object)
