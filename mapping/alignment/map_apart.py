"""A map apart: a temporary map in memory that knows the same categories as another one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from kg.errors import OntologyError
from kg.maps.semantic_map import SemanticMap
from kg.opening import in_memory_map


@contextmanager
def map_apart(semantic_map: SemanticMap) -> Iterator[SemanticMap]:
    """Empty map in memory with the ontology of `semantic_map`.

    With the shipped one where that of an older map lacks terms that maps are now written in.
    """
    with in_memory_map() as apart:
        ontology = semantic_map.ontology()
        if set(ontology) != set(apart.ontology()):
            with suppress(OntologyError):
                apart.take_ontology(ontology, whole=True)
        yield apart
