"""Ingestion: updates and RDF documents of clients, evaluated and parsed in a worker.

The writer receives only ground quads, as N-Quads of limited size and without triple terms.
"""

from __future__ import annotations

import base64
import gc
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pyoxigraph import Quad, RdfFormat, Store, parse, serialize

from kg.maps.update import execution
from kg.maps.update.change_draft import check_triple_terms
from kg.model.errors import ConflictError, QueryRefusedError
from kg.rdf.parsing import DOCUMENT_TYPE, NO_LOADER, REMOTE_CONTEXT, has_document_type
from kg.rdf.sparql.order_by import with_total_order
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
