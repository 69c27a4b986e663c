"""Export of the ontology of a map as one file for OWL editors."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pyoxigraph import RdfFormat, Triple

from kg.export.owl_document import with_one_header
from kg.export.serialization import serialised
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.store.atomic_file import write_atomically

_FORMATS: Final = {
    ".ttl": RdfFormat.TURTLE,
    ".owl": RdfFormat.RDF_XML,
    ".rdf": RdfFormat.RDF_XML,
    ".nt": RdfFormat.N_TRIPLES,
}


def export_ontology(semantic_map: SemanticMap, path: Path) -> int:
    """Write the ontology of the map to `path`, imports included; returns the number of triples.

    The file has one OWL header, with the name of the map's ontology. Raises OntologyError for an
    ending other than .ttl, .owl, .rdf or .nt, and GraphError if the file cannot be written.
    """
    form = _FORMATS.get(path.suffix.lower())
    if form is None:
        raise OntologyError(
            f"cannot tell the format of {path.name!r} from its ending; use {', '.join(_FORMATS)}"
        )
    merged = with_one_header(
        (quad.triple for quad in semantic_map.ontology.quads()),
        semantic_map.base + "ontology",
        f"ontology of {semantic_map.description.title}",
    )
    triples = sorted(set(merged), key=_order)
    write_atomically(path, serialised(triples, form, v.PREFIXES))
    return len(triples)


def _order(triple: Triple) -> tuple[bool, str, bool, str, str]:
    subject = str(triple.subject)
    is_type = triple.predicate == v.RDF_TYPE
    return subject.startswith("_:"), subject, not is_type, str(triple.predicate), str(triple.object)
