"""Writes to a map: frames of a mapper, updates, restorations, assertions, ontologies, labels."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from pyoxigraph import Quad

from kg.facts.assertion_service import AssertionService
from kg.facts.frame_writer import FrameWriter
from kg.facts.map_metadata import changed_description
from kg.facts.objects_and_places import RecordCodec
from kg.history.timestamps import Instant, sequence_of
from kg.maps.past_access import PastAccess
from kg.ontology.catalogue import StoredCatalogue
from kg.ontology.loading import Ontology
from kg.ontology.provisional_classes import add_provisional_classes, clean
from kg.rdf.skolem import anonymous
from kg.records import MapUpdate
from kg.store.transactional import TransactionalStore
from kg.transactions import Cause, ChangeSet
from kg.update.change_draft import ChangeDraft
from kg.update.completion import complete_change
from kg.update.deletion_guard import DeletionLimit, check_confirmed
from kg.update.execution import evaluate_update
from kg.update.ground_update import GroundUpdate
from kg.update.recompilation import recompile_commonsense
from kg.update.validation import UpdateValidator

if TYPE_CHECKING:
    from kg.ontology.replacement import Replacement
    from kg.update.restoration import Restored

MAX_NOTE = 500  # characters of an update kept with its transaction


class MapWriter:
    """Writes to the map in `store`, one thread at a time, as `SemanticMap` documents its methods.

    `guard` is held from reading to writing. `deletion_limit` is the largest deletion that updates
    and restorations make unconfirmed.
    """

    def __init__(
        self,
        store: TransactionalStore,
        facts: RecordCodec,
        categories: StoredCatalogue,
        past: PastAccess,
    ) -> None:
        self.guard = threading.RLock()
        self.deletion_limit = DeletionLimit()
        self._store, self._facts, self._categories, self._past = store, facts, categories, past
        self._writer = FrameWriter(store, facts)
        self.assertions = AssertionService(store, facts, self._writer)
        self._validator: UpdateValidator | None = None  # made at the first update

    def new_object_iri(self) -> str:
        """An IRI no object of this map has had or will have."""
        with self.guard:
            return self._writer.new_object_iri()

    @property
    def next_object(self) -> int:
        """The number of the next object."""
        with self.guard:
            return self._writer.next_number

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Write what changed in one transaction."""
        with self.guard:
            return self._writer.change(update, cause or frame_cause(update))

    def written_by(self, update: MapUpdate) -> frozenset[str]:
        """IRIs of the things whose facts `update` may change."""
        return frozenset(node.value for node in self._writer.subjects(update))

    def update(
        self,
        sparql: str,
        *,
        by: str | None = None,
        allow: Collection[str] = (),
        confirmed: bool = False,
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update as one transaction."""
        with self.guard:
            self._store.check_writable()
            update = evaluate_update(self._store, sparql, self._facts.base)
            return self.apply_ground(update, sparql, by=by, allow=allow, confirmed=confirmed)

    def apply_ground(
        self,
        update: GroundUpdate,
        note: str,
        *,
        by: str | None = None,
        allow: Collection[str] = (),
        confirmed: bool = False,
    ) -> ChangeSet | None:
        """Validate and apply an evaluated update as one transaction."""
        with self.guard:
            self._store.check_writable()
            validator = self._validation()
            draft = ChangeDraft(self._store)
            draft.apply(update)
            draft.skolemise()
            validator.check_permissions(draft, allow)
            complete_change(draft, self._facts, by)
            if not confirmed:
                check_confirmed(draft, self._facts, self.deletion_limit)
            validator.check_shapes(draft)
            recompile_commonsense(draft)
            cause = Cause("update", by, " ".join(note.split())[:MAX_NOTE])
            change = self._store.commit(draft.removed, draft.added, cause)
            if allow and change is not None:
                self.reread_ontology()
            return change

    def restore(
        self,
        when: Instant,
        *,
        only: Collection[str] = (),
        by: str | None = None,
        confirmed: bool = False,
        dry_run: bool = False,
    ) -> Restored:
        """Write a past state back as one new transaction."""
        from kg.update.restoration import Restoration

        with self.guard:
            self._store.check_writable()
            sequence = sequence_of(self._past.history, when)
            work = Restoration(
                *(self._store, self._past.history, self._facts, self.assertions),
                sequence=sequence,
                only=only,
            )
            changes_ontology, outcome = work.changes_ontology, work.outcome()
            if only and not changes_ontology:
                self._validation().check_shapes(work.pending)
            if dry_run:
                return outcome
            if not confirmed:
                check_confirmed(work.pending, self._facts, self.deletion_limit)
            note = " ".join((f"the state of #{sequence}", *only))[:MAX_NOTE]
            cause = Cause("restore", by, note)
            change = self._store.commit(work.pending.removed, work.pending.added, cause)
            if changes_ontology:
                self.reread_ontology()
            return replace(outcome, sequence=change.sequence if change else None)

    def describe(
        self, title: str | None, licence: str | None, *, by: str | None
    ) -> ChangeSet | None:
        """Set title or licence as one transaction."""
        with self.guard:
            self._store.check_writable()
            removed, added = changed_description(
                self._store.engine, self._facts.base, title, licence
            )
            return self._store.commit(removed, added, Cause("update", by, "description"))

    def _validation(self) -> UpdateValidator:
        self._validator = self._validator or UpdateValidator(self._store)
        return self._validator

    def take_ontology(
        self, quads: Iterable[Quad], *, by: str | None = None, whole: bool = False
    ) -> Replacement:
        """Replace the ontology in one transaction."""
        from kg.ontology.diagnostics import reject_invalid
        from kg.ontology.replacement import replace_ontology

        ontology = Ontology(tuple(anonymous(quads)), ())
        reject_invalid(ontology)
        with self.guard:
            taken = replace_ontology(self._store, ontology.quads, by, whole=whole)
            if taken.commit is not None:
                self.reread_ontology()
            return taken

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """The category of each label of a network, provisional ones added."""
        names = {label: clean(label) for label in labels}
        with self.guard:
            self._store.check_writable()
            unknown = [n for n in names.values() if n and not self._categories().for_label(n, kind)]
            if (
                add_provisional_classes(self._store, self._categories(), unknown, kind, model)
                is not None
            ):
                self.reread_ontology()
            found = {
                label: self._categories().for_label(n, kind) for label, n in names.items() if n
            }
        return {label: category.iri for label, category in found.items() if category is not None}

    def assert_(self, iri: str, prop: str, value: object, *, by: str) -> ChangeSet | None:
        """Assert a property of a thing."""
        with self.guard:
            return self.assertions.assert_(iri, prop, value, by)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Retract an assertion."""
        with self.guard:
            return self.assertions.retract(iri, prop, by)

    def reread_ontology(self) -> None:
        """Read the categories and shapes again at their next use."""
        self._categories.forget()
        self._validator = None


def frame_cause(update: MapUpdate) -> Cause:
    """The cause of a mapper's transaction: recording and frame of `update`."""
    recording = update.recording
    note = f"{recording.name}/{recording.last_frame}" if recording else ""
    return Cause("frame", note=note)
