"""Reload of an edited ontology into a map in a folder or on a server."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import RdfFormat, serialize

from kg.knowledge.ontology.diagnostics import check_valid
from kg.knowledge.ontology.diff import OntologyChange, changes
from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.loading import SHAPES_FILE, Ontology
from kg.knowledge.ontology.replacement import check_complete
from kg.model.errors import OntologyError
from kg.rdf.findings import Finding
from kg.serving.client.record_codec import Json
from kg.serving.client.served_server import ServedClient
from kg.serving.opening import open_map
from kg.serving.workers.updates import IsolatedParser
from kg.store.folder import is_url


@dataclass(frozen=True, slots=True)
class Reloaded:
    """Result of a reload: the changes, the triples, and the transaction's number."""

    changes: tuple[OntologyChange, ...]
    kept: tuple[str, ...] = ()  # relations that persons edited in the map
    warnings: tuple[Finding, ...] = ()
    sequence: int = 0
    added: int = 0
    removed: int = 0


def reload(
    address: str,
    source: Path,
    *,
    by: str | None = None,
    whole: bool = False,
    reason: bool = False,
    dry: bool = False,
) -> Reloaded:
    """Validate the ontology at `source` and make it that of the map at `address`.

    `address` is a map's folder or a running `hereabouts serve`, which then uses the new ontology.
    Unless it is `whole`, a file must contain or import all ontologies
    of the map. `reason` runs HermiT too; `dry` changes nothing. Raises OntologyError for an invalid
    ontology (the map is then unchanged), GraphError, RemoteError.
    """
    with IsolatedParser() as parse:
        ontology = load_with_imports(source, parse)
    whole = whole or source.is_dir()
    served = ServedClient.at(address) if is_url(address) and not dry else None
    with contextlib.nullcontext() if served is None else contextlib.closing(served):
        has_shapes = (ontology.files[0].parent / SHAPES_FILE).is_file()
        if served is not None and not (reason or has_shapes):
            return _put(
                served, ontology, whole
            )  # it validates what it is sent, which takes seconds
        warnings = tuple(check_valid(ontology, reason=reason))
        if served is not None:
            return _put(served, ontology, whole)
    if dry:
        present = ontology_of_map(address)
        check_complete(present.quads, ontology.quads, whole=whole)
        return Reloaded(tuple(changes(present.quads, ontology.quads)), warnings=warnings)
    with open_map(address) as semantic_map:
        taken = semantic_map.ontology.replace(ontology.quads, by=by, whole=whole)
        commit, sequence = taken.commit, semantic_map.sequence
    counts = (len(commit.added), len(commit.removed)) if commit else (0, 0)
    return Reloaded(taken.changes, taken.kept, warnings, sequence, *counts)


def _put(served: ServedClient, ontology: Ontology, whole: bool) -> Reloaded:
    """Send an ontology to a server; a refusal names the file and line where they are known."""
    body = serialize([q.triple for q in ontology.quads], format=RdfFormat.N_TRIPLES) or b""

    def decode(reply: Json) -> Reloaded:
        return Reloaded(
            tuple(OntologyChange(**change) for change in reply["changes"]),
            tuple(reply["kept"]),
            (*ontology.findings, *(Finding(**one) for one in reply.get("warnings", ()))),
            reply["sequence"],
            reply["added"],
            reply["removed"],
        )

    try:
        return served.take_ontology(body, decode, whole=whole)
    except OntologyError:
        check_valid(ontology)
        raise


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
        return Ontology(semantic_map.ontology.quads())
