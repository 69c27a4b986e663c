"""Where an ontology can come from, for comparing: files, a map's folder, a server with a map."""

from __future__ import annotations

from pathlib import Path

from kg.editing.imports import load_with_imports
from kg.endpoint import is_url
from kg.ontology import Ontology
from kg.semantic_map import SemanticMap


def ontology_at(address: str) -> Ontology:
    """The ontology of a file or folder (with imports), of a map, or of a map on a server.

    Raises OntologyError, GraphError.
    """
    if is_url(address) or (Path(address) / "store" / "CURRENT").is_file():
        return ontology_of_map(address)
    return load_with_imports(Path(address))


def ontology_of_map(address: str) -> Ontology:
    """The ontology of the map in a folder or on a server; raises GraphError."""
    with SemanticMap.open(address, read_only=True) as semantic_map:
        return Ontology(semantic_map.ontology(), ())
