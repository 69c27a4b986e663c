"""Tasks of a worker beside queries: the map's history, a new ontology, documents of clients.

A worker reads the history's file while another process writes it; one request reads one state. The
shapes, the hierarchy and the relations of an ontology that a client sends can take any time and
memory, so the worker computes the quads to delete and to insert. The writer receives only ground
quads, as N-Quads of limited size and without triple terms.
"""

from __future__ import annotations

import base64
import gc
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from pyoxigraph import Quad, RdfFormat, Store, parse, serialize

from kg.history.replay.map_state import Categories, present_state, state_after
from kg.history.replay.point_in_time import PastStates, difference
from kg.history.reports.comparison import compare, timeline
from kg.history.reports.events import (
    comparison_text,
    difference_text,
    history_events,
    log_text,
    reasons_text,
)
from kg.history.reports.explanation import explain_fact
from kg.history.reports.prov_export import provenance
from kg.history.storage.log import HistoryLog
from kg.history.timestamps import iso, thing
from kg.knowledge.ontology.diagnostics import check_valid
from kg.knowledge.ontology.loading import SHAPES_FILE, ontology_of
from kg.knowledge.ontology.replacement import plan_replacement
from kg.maps.facts.robot_and_recordings import recordings_in
from kg.maps.update import execution
from kg.maps.update.change_draft import GroundUpdate, QuadChange, check_triple_terms
from kg.model.errors import ConflictError, QueryRefusedError
from kg.model.resources import ONTOLOGIES
from kg.rdf.parsing import DOCUMENT_TYPE, NO_LOADER, REMOTE_CONTEXT, has_document_type
from kg.rdf.skolem import anonymous
from kg.rdf.sparql.order_by import with_total_order
from kg.rdf.sparql.update_parser import with_graphs
from kg.serving.client.record_codec import (
    comparison_to_json,
    difference_to_json,
    entry_to_json,
    reason_to_json,
    timeline_to_json,
)

JSON: Final = "application/json"
TEXT: Final = "text/plain"
TURTLE: Final = "text/turtle"


def past_store(states: PastStates, store: Store, request: Mapping[str, Any]) -> Store:
    """The state right after the transaction ``at``; `store` is a snapshot of the map."""
    with _frozen(request) as log:
        return states.at(log, store, int(request["at"]))


def history_report(store: Store, request: Mapping[str, Any]) -> str:
    """A report on the history, in the media type of the request."""
    with _frozen(request) as log:
        return _REPORTS[request["what"]](store, log, request)


def _log(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    base = request["base"]
    entries = list(history_events(log, thing(request["iri"], base), base))
    if request["last"] is not None:
        entries = entries[max(0, len(entries) - int(request["last"])) :]
    if request["media_type"] == TEXT:
        return log_text(entries)
    return _dumped([entry_to_json(entry) for entry in entries])


def _diff(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    before, after = int(request["before"]), int(request["after"])
    log.check_kept(min(before, after))
    base, is_text = request["base"], request["media_type"] == TEXT
    if request["facts"]:
        facts = difference(log, before, after)
        return difference_text(facts, base) if is_text else _dumped(difference_to_json(facts))
    found = compare(log, Categories.of(store), base, before, after, request["far"])
    found = replace(found, surface=tuple(request["surface"]))
    return comparison_text(found) if is_text else _dumped(comparison_to_json(found))


def _timeline(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    base = request["base"]
    state = present_state(store, Categories.of(store), base)
    there = {base + row["iri"] for row in state["objects"]}
    return _dumped(timeline_to_json(timeline(log, base, there)))


def map_state(store: Store, sequence: int, request: Mapping[str, Any]) -> str:
    """The state of the map that a page draws: after the transaction ``at``, or of `store`."""
    categories, base = Categories.of(store), request["base"]
    head: dict[str, object] = {"sequence": request.get("at", sequence)}
    head["surface"] = request["surface"]
    head["poses"] = [one.pose_estimate for one in recordings_in(store, base) if one.pose_estimate]
    if "at" in request:
        with _frozen(request) as log:
            state = state_after(log, int(request["at"]), categories, base)
            head["time"] = iso(log.time_of(int(request["at"])))
    else:
        state = present_state(store, categories, base)
    if not request["objects"]:
        del state["objects"], state["things"]
    return _dumped(head | state)


def _why(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    reasons = explain_fact(store, log, request["base"], request["about"])
    if request["media_type"] == TURTLE:
        return provenance(*reasons)
    if request["media_type"] == TEXT:
        return reasons_text(reasons)
    return _dumped([reason_to_json(reason) for reason in reasons])


_REPORTS: Final[dict[str, Callable[[Store, HistoryLog, Mapping[str, Any]], str]]] = {
    "log": _log,
    "diff": _diff,
    "timeline": _timeline,
    "why": _why,
}


@contextmanager
def _frozen(request: Mapping[str, Any]) -> Iterator[HistoryLog]:
    """The history in one read transaction, unchanged by concurrent writes and pruning."""
    file, base = Path(request["log"]), request["base"]
    with closing(HistoryLog.open(file, base, read_only=True, live=True)) as log:
        log.db.execute("PRAGMA temp_store = MEMORY")  # a worker writes no files
        log.db.execute("BEGIN")
        log.refresh()
        yield log


def _dumped(report: object) -> str:
    return json.dumps(report, ensure_ascii=False) + "\n"


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
    warnings = check_valid(ontology)
    plan = plan_replacement(store, ontology.quads, whole=request["whole"])
    head, body = GroundUpdate((QuadChange(plan.delete, plan.insert),)).encode()
    head |= {"kept": plan.kept, "lost": plan.lost, "unnamed": plan.unnamed}
    head |= {"warnings": [asdict(warning) for warning in warnings]}
    return head | {"changes": [asdict(change) for change in plan.changes]}, body
