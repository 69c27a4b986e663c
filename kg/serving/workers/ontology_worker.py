"""Ontologies of clients: planned in a process of their own, written by the writer.

A plan depends on the ontology of the map and on the categories that its facts use. It is written
only if these have not changed since; otherwise it is made again.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from pyoxigraph import RdfFormat

from kg.knowledge.ontology.diff import OntologyChange
from kg.knowledge.ontology.replacement import Replacement, ReplacementPlan
from kg.maps.stored_map import StoredMap
from kg.maps.update.change_draft import GroundUpdate
from kg.model.errors import (
    ConflictError,
    OntologyError,
    QueryTimeoutError,
    QueryTooLargeError,
)
from kg.model.resources import ONTOLOGIES
from kg.rdf.findings import Finding
from kg.serving.workers.admission import FairQueue
from kg.serving.workers.process import Answer, WorkerProcess
from kg.store.snapshots import Snapshots

SECONDS: Final = 60.0  # for one ontology, and to wait for its turn
ATTEMPTS: Final = 3  # while others change the ontology


@dataclass(frozen=True, slots=True)
class OntologyDocument:
    """An ontology that a client sends; `whole` is as of `MapOntology.replace`."""

    body: bytes
    form: RdfFormat
    base: str
    whole: bool
    client: str = ""


class OntologyWorker:
    """Plans replacements of the ontology, one at a time, each in a process of its own."""

    def __init__(
        self, settings: dict[str, Any], snapshots: Snapshots, queue: int, max_bytes: int
    ) -> None:
        packages = map(find_spec, ("pyshacl", "rdflib"))
        folders = (str(Path(found.origin).parent) for found in packages if found and found.origin)
        readable = [*settings["readable"], str(ONTOLOGIES.resolve()), *folders]
        self._settings = settings | {"readable": readable, "ontologies": True}
        self._snapshots = snapshots
        self._queue, self._max_bytes = FairQueue(1, queue), max_bytes

    def plan(self, document: OntologyDocument, at_least: int) -> tuple[ReplacementPlan, int]:
        """The plan, from a snapshot with transaction `at_least`, and the snapshot's last one.

        Raises OntologyError for an invalid ontology, and for one that needs more time or memory
        than it may have; PoolBusyError; QueryError for a document that does not parse.
        """
        try:
            with self._queue.turn(document.client, "present", SECONDS):
                answer = self._answer(document, at_least)
        except QueryTimeoutError as error:
            raise _refused(f"it takes more than {SECONDS:g} s to check") from error
        except QueryTooLargeError as error:
            megabytes = self._settings["memory"] >> 20
            raise _refused(f"it needs more than {megabytes} MB of memory to check") from error
        return _decoded(answer), answer.sequence

    def close(self) -> None:
        """Refuse what waits."""
        self._queue.close()

    def _answer(self, document: OntologyDocument, at_least: int) -> Answer:
        request = {
            "name": "the body",
            "form": document.form.media_type,
            "base_iri": document.base,
            "body": base64.b64encode(document.body).decode("ascii"),
            "whole": document.whole,
            "max_bytes": self._max_bytes,
        }
        with (
            self._snapshots.naming_full_disk(),
            self._snapshots.leased(at_least) as snapshot,
            closing(WorkerProcess(self._settings)) as worker,
        ):
            return worker.ask(request | {"folder": str(snapshot.folder)}, SECONDS, b"N")


def replace_ontology(
    worker: OntologyWorker,
    semantic_map: StoredMap,
    document: OntologyDocument,
    *,
    by: str | None,
    check: Callable[[], None],
) -> Replacement:
    """Replace the ontology of a map that is in use; others write while the plan is made.

    `check` may raise an error right before the replacement is written, while nobody else writes.
    Raises as `OntologyWorker.plan`; ConflictError where others change the ontology again and again.
    """
    semantic_map.store.check_writable()
    for _ in range(ATTEMPTS):
        plan, sequence = worker.plan(document, semantic_map.sequence)
        with semantic_map.hold():
            check()
            if _fits(plan, semantic_map, sequence):
                return semantic_map.ontology.write(plan, by)
    raise ConflictError("others change the ontology of the map meanwhile; try again later")


def _fits(plan: ReplacementPlan, semantic_map: StoredMap, sequence: int) -> bool:
    """Whether nobody changed the ontology since transaction `sequence`, or uses what it loses."""
    now = semantic_map.sequence
    if sequence == now:
        return True
    log = semantic_map.history.log
    changed = any(map(any, log.change_lines(sequence, now, background=True)))
    return not changed and plan.fits(semantic_map.engine)


def _refused(reason: str) -> OntologyError:
    return OntologyError(f"the ontology is refused: {reason}; a smaller one would work")


def _decoded(answer: Answer) -> ReplacementPlan:
    """The planned replacement that a worker sent."""
    head = answer.details
    (step,) = GroundUpdate.decode(dict(head), answer.body).steps
    return ReplacementPlan(
        changes=tuple(OntologyChange(**change) for change in head["changes"]),
        kept=tuple(head["kept"]),
        delete=step.delete,
        insert=step.insert,
        lost=tuple(head["lost"]),
        unnamed=head["unnamed"],
        warnings=tuple(Finding(**warning) for warning in head["warnings"]),
    )
