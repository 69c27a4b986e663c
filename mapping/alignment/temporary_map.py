"""Temporary map in memory with the ontology of another one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import OntologyError
from kg.serving.opening import in_memory_map


@contextmanager
def temporary_map(semantic_map: SemanticMap) -> Iterator[SemanticMap]:
    """Empty map in memory with the ontology of `semantic_map`.

    It has the shipped ontology if an older map lacks terms of the present vocabulary.
    """
    with in_memory_map() as temporary:
        ontology = semantic_map.ontology.quads()
        if set(ontology) != set(temporary.ontology.quads()):
            with suppress(OntologyError):
                temporary.ontology.replace(ontology, whole=True)
        yield temporary
