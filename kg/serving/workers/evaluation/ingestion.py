"""Ingestion: updates, RDF documents and ontologies of clients, evaluated in a worker.

The writer receives only ground quads, as N-Quads of limited size and without triple terms.

An ontology that replaces a map's own is validated and compiled here. The shapes, the hierarchy and
the relations of an ontology that a client sends can take any time and memory. The worker computes
the quads to delete and to insert; the writer receives only these.
"""

from __future__ import annotations

import base64
import gc
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pyoxigraph import Quad, RdfFormat, Store, parse, serialize

from kg.knowledge.ontology.diagnostics import check_valid
from kg.knowledge.ontology.loading import SHAPES_FILE, check_limits, ontology_of
from kg.knowledge.ontology.replacement import plan_replacement
from kg.maps.update import execution
from kg.maps.update.change_draft import GroundUpdate, QuadChange, check_triple_terms
from kg.model.errors import ConflictError, QueryRefusedError
from kg.model.resources import ONTOLOGIES
from kg.rdf.parsing import DOCUMENT_TYPE, NO_LOADER, REMOTE_CONTEXT, has_document_type
from kg.rdf.skolem import anonymous
from kg.rdf.sparql.engine_gaps import with_total_order
from kg.rdf.sparql.update_parser import with_graphs

Request = dict[str, Any]


class SnapshotView:
    """A snapshot as the dataset of an update; it must have the state of the request."""

    def __init__(self, store: Store, folder: str, sequence: int, request: Request) -> None:
        self._store, self._folder, self._sequence = store, folder, sequence
        self._least, self._scratch = int(request["least"]), Path(request["scratch"])

    @property
    def native(self) -> Store:
        """The quads; raises ConflictError if the map has changed since the snapshot."""
        if self._sequence < self._least:
            raise ConflictError(f"the snapshot is of transaction {self._sequence}")
        return self._store

    @contextmanager
    def copied(self) -> Iterator[Store]:
        """A copy that may be written; its files are shared with the snapshot's."""
        self.native.backup(str(self._scratch))
        try:
            copy = Store(str(self._scratch))
            yield copy
            del copy
        finally:
            gc.collect()
            shutil.rmtree(self._scratch, ignore_errors=True)


def evaluate_update(view: SnapshotView, request: Request) -> tuple[dict[str, Any], bytes]:
    """The evaluated update, encoded by `kg.maps.update.change_draft.GroundUpdate.encode`."""
    sparql = with_graphs(request["sparql"], request["default_graphs"], request["named_graphs"])
    if request.get("total_order"):
        sparql = with_total_order(sparql)
    return execution.evaluate_update(view, sparql, request["base_iri"]).encode()


def parse_document(request: Request) -> bytes:
    """The quads of an RDF document, as N-Quads.

    Raises as `quads_of_document`.
    """
    return serialize(quads_of_document(request), format=RdfFormat.N_QUADS) or b""


def quads_of_document(request: Request) -> list[Quad]:
    """The quads of an RDF document.

    Raises SyntaxError, QueryRefusedError for RDF/XML with a document type, whose entities can grow
    beyond any limit, and ShapeError for triple terms.
    """
    body, form = base64.b64decode(request["body"]), RdfFormat.from_media_type(request["form"])
    assert form is not None
    if form == RdfFormat.RDF_XML and has_document_type(body):
        raise QueryRefusedError(DOCUMENT_TYPE)
    try:
        quads = list(parse(body, format=form, base_iri=request["base_iri"]))
    except SyntaxError as error:
        if NO_LOADER not in str(error):
            raise
        raise SyntaxError(REMOTE_CONTEXT) from None
    check_triple_terms(quads)
    return quads


def load_libraries() -> None:
    """Import all that `plan_ontology` needs, before the process is confined."""
    from kg.rdf.shacl import validate

    validate((), ONTOLOGIES / SHAPES_FILE)  # the libraries import some modules at the first use


def plan_ontology(store: Store, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """The planned replacement of the ontology in a snapshot by a document.

    Raises as `ingestion.quads_of_document` and `plan_replacement`; OntologyError for an invalid
    ontology.
    """
    ontology = ontology_of(anonymous(quads_of_document(request)))
    check_limits(ontology.quads)  # at once: to validate a large one takes a minute
    warnings = check_valid(ontology)
    plan = plan_replacement(store, ontology.quads, whole=request["whole"])
    head, body = GroundUpdate((QuadChange(plan.delete, plan.insert),)).encode()
    head |= {"kept": plan.kept, "lost": plan.lost, "unnamed": plan.unnamed}
    head |= {"warnings": [asdict(warning) for warning in warnings]}
    return head | {"changes": [asdict(change) for change in plan.changes]}, body
