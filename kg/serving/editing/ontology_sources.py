"""Sources of ontologies: files, the folder of a map, a server with a map."""

from __future__ import annotations

from pathlib import Path

from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.loading import Ontology
from kg.serving.opening import open_map
from kg.store.sparql_client import is_url


def ontology_at(address: str) -> Ontology:
    """The ontology of a file or folder (with imports), of a map, or of a map on a server.

    Raises OntologyError, GraphError.
    """
    if is_url(address) or (Path(address) / "store" / "CURRENT").is_file():
        return ontology_of_map(address)
    return load_with_imports(Path(address))


def ontology_of_map(address: str) -> Ontology:
    """The ontology of the map in a folder or on a server; raises GraphError."""
    with open_map(address, read_only=True) as semantic_map:
        return Ontology(semantic_map.ontology.quads(), ())
