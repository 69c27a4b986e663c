"""The shipped ontology as in a new map, compiled once in a process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from pyoxigraph import Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import compile_commonsense, ontology_files, read_files
from kg.model.resources import ONTOLOGIES
from kg.rdf.skolem import named


@dataclass(frozen=True, slots=True)
class CompiledOntology:
    """The quads of graph:ontology and graph:commonsense, and the categories they declare."""

    quads: tuple[Quad, ...]
    catalogue: Catalogue


def shipped_ontology() -> CompiledOntology:
    """The ontology of hereabouts, recompiled only after a change of its files.

    Raises OntologyError if a file does not parse.
    """
    files = ontology_files(ONTOLOGIES)
    return _compiled(tuple((path, path.read_bytes()) for path in files))


@lru_cache(maxsize=1)
def _compiled(contents: tuple[tuple[Path, bytes], ...]) -> CompiledOntology:
    # the contents are the cache key; files are read by name, so that errors have the names
    ontology = named(read_files(path for path, _ in contents).quads)
    return CompiledOntology(
        (*ontology, *compile_commonsense(ontology)), Catalogue.from_quads(ontology)
    )
