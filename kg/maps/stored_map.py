"""A map in a store of this process: a folder, memory, or a published map."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, TypeVar

from numpy.typing import ArrayLike
from pyoxigraph import NamedNode

from kg.history.point_in_time import background_changes
from kg.history.storage.log import HistoryLog
from kg.history.timestamps import Instant, sequence_of
from kg.knowledge.ontology.catalogue import Catalogue, StoredCatalogue
from kg.knowledge.ontology.loading import compile_commonsense
from kg.knowledge.ontology.replacement import compiled_before, recompiled
from kg.maps.facts.assertion_service import AssertionService
from kg.maps.facts.coordinate_frames import (
    changed_frame,
    chosen_map,
    is_one_frame,
    maps_in,
    quads_in_one_frame,
)
from kg.maps.facts.frame_writer import FrameWriter
from kg.maps.facts.replaced_values import noted
from kg.maps.map_extent import check_written
from kg.maps.map_metadata import changed_description, identity
from kg.maps.map_parts import lazy
from kg.maps.room_editor import RoomEditor
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_history import StoredHistory
from kg.maps.stored_ontology import StoredOntology
from kg.maps.subscriptions import StoredSubscriptions
from kg.maps.surface.surface_store import SurfaceStore
from kg.maps.surface.voxels import Surface
from kg.maps.thing_names import check_label
from kg.maps.update.change_draft import ChangeDraft, GroundUpdate
from kg.maps.update.completion import complete_change
from kg.maps.update.execution import evaluate_update
from kg.maps.update.validation import DeletionLimit, check_confirmed, drop_inferred_types
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.model.records import MapUpdate
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.skolem import named
from kg.store.scheduling import WriterLock, check_facts
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    from kg.maps.update.restoration import Restoration, Restored

Prepared = TypeVar("Prepared")
Result = TypeVar("Result")

ATTEMPTS: Final = 3  # to write what was prepared while others wrote

_LABEL: Final = NamedNode(v.RDFS_LABEL)
MAX_NOTE: Final = 500  # characters of an update kept with its transaction


class StoredMap(SemanticMap):
    """A map in `store`; one thread writes at a time.

    `deletion_limit` is the largest deletion without confirmation.
    """

    history: StoredHistory
    ontology: StoredOntology = lazy(
        lambda self: StoredOntology(self.store, self._categories, self._guard)
    )
    assertions: AssertionService = lazy(
        lambda self: AssertionService(
            *(self.store, self._facts, self.perceived, lambda: self._writer, self._guard),
            names=lambda: self.ontology,
            history=self.history,
            resolve=self.resolve,
        )
    )
    rooms: RoomEditor = lazy(
        lambda self: RoomEditor(
            *(self.store, self._facts, self.perceived, self._writer),
            assertions=self.assertions,
            history=self.history,
            guard=self._guard,
        )
    )
    subscriptions: StoredSubscriptions = lazy(
        lambda self: StoredSubscriptions(self.query, self.store)
    )
    surface_store: SurfaceStore | None = lazy(lambda self: self._opened_surface())
    _writer: FrameWriter = lazy(lambda self: FrameWriter(self.store, self._facts))

    def __init__(
        self,
        store: TransactionalStore,
        *,
        base: str | None = None,
        catalogue: Catalogue | None = None,
        history: HistoryLog | None = None,
    ) -> None:
        categories = StoredCatalogue(lambda: store.engine, catalogue)
        super().__init__(store, identity(store) if base is None else base, categories)
        self.deletion_limit = DeletionLimit()
        self._guard = WriterLock()  # held from reading to writing
        self.history = StoredHistory(store, self.base, history, self._surface_area)
        self._opened_at = store.sequence
        self.on_close: list[Callable[[], None]] = []
        self.read_surface: Callable[[int], Surface] | None = None  # of a past state, or of a copy

    @property
    def next_object(self) -> int:
        """The number of the next object."""
        with self._guard:
            return self._writer.next_number

    def new_object_iri(self) -> str:
        """An IRI that no object of this map has had or will have."""
        with self._guard:
            return self._writer.new_object_iri()

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Write the changes in one transaction."""
        with self._guard:
            return self._writer.change(update, cause or frame_cause(update))

    def written_by(self, update: MapUpdate) -> frozenset[str]:
        """IRIs of the things whose facts `update` may change."""
        return frozenset(node.value for node in self._writer.subjects(update))

    def update(
        self,
        sparql: str,
        *,
        by: str | None = None,
        confirmed: bool = False,
        allow: Collection[str] = (),
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update as one transaction.

        `allow` has names of graphs ("ontology", "commonsense", "dataset", "history", "assertions")
        that may be written though they usually may not.
        """
        with self._guard:
            self.store.check_writable()
            update = evaluate_update(self.store, sparql, self.base)
            return self.apply_ground(update, sparql, by=by, allow=allow, confirmed=confirmed)

    def apply_ground(
        self,
        update: GroundUpdate,
        note: str,
        *,
        by: str | None = None,
        allow: Collection[str] = (),
        confirmed: bool = False,
        replaced: NamedNode | None = None,
        check: Callable[[], None] | None = None,
    ) -> ChangeSet | None:
        """Validate and apply an evaluated update as one transaction; otherwise as `update`.

        Others write while it is validated. `replaced` is a graph whose facts are deleted first.
        `check` raises an error if the update does not fit the state of the map; it is called while
        nobody writes. `note` is stored with the transaction. Raises ConflictError if others change
        again and again what the validation reads.
        """
        self.store.check_writable()
        if check is not None:
            check()  # before the work, too

        odd: list[str] = []

        def drafted() -> ChangeDraft:
            draft = ChangeDraft(self.store)
            if replaced is not None:
                draft.change(draft.before(None, None, None, replaced), ())
            draft.apply(update)
            drop_inferred_types(draft, update)
            check_facts(len(draft.added) + len(draft.removed))
            self._complete(draft, by, allow, confirmed)
            odd[:] = check_written(self.engine, draft.added)
            return draft

        def write(draft: ChangeDraft) -> ChangeSet | None:
            if check is not None:
                check()
            cause = Cause("update", by, " ".join(note.split())[:MAX_NOTE])
            change = self.store.commit(
                draft.removed, draft.added, cause, exact_at=self.store.sequence
            )
            if allow and change is not None:
                self.ontology.reread()
            return noted(change, self.base, self._facts.catalogue, *odd)

        return self._written(drafted, lambda draft, new: draft.state.is_changed_by(new), write)

    def _complete(
        self, draft: ChangeDraft, by: str | None, allow: Collection[str], confirmed: bool
    ) -> None:
        """Add what follows from a person's change; raises an error if it is not allowed."""
        validator = self.ontology.validator()
        draft.skolemise()
        validator.check_permissions(draft, allow)
        for quad in draft.added:
            if quad.predicate == _LABEL and quad.graph_name == v.MAP_GRAPH:
                check_label(str(getattr(quad.object, "value", "")))
        complete_change(draft, self._facts, by)
        check_facts(len(draft.added) + len(draft.removed))
        if not confirmed:
            check_confirmed(draft, self._facts, self.deletion_limit)
        validator.check_shapes(draft)
        recompile_commonsense(draft)

    def _written(
        self,
        prepare: Callable[[], Prepared],
        is_stale: Callable[[Prepared, ChangeSet], bool],
        write: Callable[[Prepared], Result],
    ) -> Result:
        """Write what `prepare` computes while others write (optimistic concurrency control).

        It is computed again if a transaction meanwhile makes it stale, the last time while the
        others wait.
        """
        for attempt in range(ATTEMPTS + 1):
            with self.store.watched() as changes, ExitStack() as held:
                if attempt == ATTEMPTS:
                    held.enter_context(self._guard)
                prepared = prepare()
                with self._guard:
                    if not any(is_stale(prepared, change) for change in changes):
                        return write(prepared)
        raise AssertionError("nobody writes while the lock is held")

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
        from kg.maps.update.restoration import SCOPES, Restoration

        self.store.check_writable()
        sequence = sequence_of(self.history.log, when)
        only = [name if name in SCOPES else self._called(name, sequence) for name in only]

        def prepared() -> tuple[Restoration, Restored]:
            work = Restoration(
                *(self.store, self.history.log, self._facts, self.assertions),
                sequence=sequence,
                only=only,
            )
            outcome = work.outcome()
            if only and not work.changes_ontology:
                self.ontology.validator().check_shapes(work.pending)
            if not (confirmed or dry_run):
                check_confirmed(work.pending, self._facts, self.deletion_limit)
            return work, outcome

        def write(made: tuple[Restoration, Restored]) -> Restored:
            work, outcome = made
            if dry_run:
                return outcome
            note = " ".join((f"the state of #{sequence}", *only))[:MAX_NOTE]
            cause = Cause("restore", by, note)
            change = self.store.commit(work.pending.removed, work.pending.added, cause)
            if work.changes_ontology:
                self.ontology.reread()
            return replace(outcome, sequence=change.sequence if change else None)

        return self._written(prepared, lambda made, new: True, write)

    def describe(
        self, *, title: str | None = None, licence: str | None = None, by: str | None = None
    ) -> ChangeSet | None:
        """Set title or licence as one transaction."""
        with self._guard:
            self.store.check_writable()
            removed, added = changed_description(self.engine, self.base, title, licence)
            return self.store.commit(removed, added, Cause("update", by, "description"))

    def surface(self, *, min_count: int = 1) -> Surface:
        """The coloured voxels of what depth images showed."""
        if self.read_surface is not None:
            return self.read_surface(min_count)
        store = self.surface_store
        return Surface.empty() if store is None else store.surface(min_count=min_count)

    def _opened_surface(self) -> SurfaceStore | None:
        store = self.store
        if store.path is None and store.read_only:
            return None
        read_only = store.read_only or store.shared
        return SurfaceStore(store.path, self._opened_at, read_only=read_only, live=store.live)

    def _surface_area(self, sequence: int) -> float:
        return 0.0 if self.surface_store is None else self.surface_store.area(sequence)

    def close(self) -> None:
        """Flush and close the store; a second call does nothing."""
        for ending in self.on_close:
            ending()
        super().close()
        surface: SurfaceStore | None = vars(self).get("surface_store")
        if surface is not None:
            surface.close()

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Lock the map against writes of other threads."""
        with self._guard:
            yield

    def in_one_frame(self, name: str | None = None) -> SemanticMap:
        """This map with those of its store that have a known way to its frame, in its frame."""
        if name is None and len(maps_in(self.engine)) <= 1:
            return self
        base = self.base if name is None else chosen_map(self.engine, name)
        if is_one_frame(self.engine, base):
            return self if base == self.base else StoredMap(self.store, base=base)
        with self.hold():
            quads = quads_in_one_frame(self.engine, base)
        return StoredMap(TransactionalStore.in_memory(quads, read_only=True), base=base)

    def place_frame(
        self, relative_to: str, T: ArrayLike, *, by: str | None = None
    ) -> ChangeSet | None:
        """State the transform to another frame as one transaction."""
        with self._guard:
            self.store.check_writable()
            removed, added = changed_frame(self.engine, self.base, relative_to, T)
            return self.store.commit(removed, added, Cause("update", by, "frame"))

    def _called(self, name: str, sequence: int) -> str:
        """IRI of a thing by its name now or after a transaction; other names as they are."""
        with suppress(QueryParameterError):
            return self.resolve("iri", name)
        with suppress(QueryParameterError), self.at(sequence) as then:
            return then.resolve("iri", name)
        return name

    def snapshot(self) -> SemanticMap:
        """A read-only copy in memory of the current state."""
        with self.hold():
            copy = StoredMap(TransactionalStore.in_memory(self.engine, read_only=True))
            return self._with_surface(copy, self.sequence)

    def at(self, when: Instant) -> SemanticMap:
        """The map as believed at `when`, replayed into memory; the last ones are cached."""
        log = self.history.log
        sequence = sequence_of(log, when)
        known = None if background_changes(log, sequence) else self._categories.known
        past = StoredMap(self.history.store_at(sequence), base=self.base, catalogue=known)
        return self._with_surface(past, sequence)

    def _with_surface(self, other: StoredMap, sequence: int) -> StoredMap:
        """`other`, with the surface of this map at a transaction."""
        if self.surface_store is not None:
            other.read_surface = partial(self.surface_store.surface, sequence)
        return other

    def _update_by_rdflib(self, sparql: str, /, *, confirmed: bool = False) -> None:
        self.update(sparql, by="rdflib", allow=("commonsense",), confirmed=confirmed)


def frame_cause(update: MapUpdate) -> Cause:
    """The cause of a mapper's transaction: recording and frame of `update`."""
    recording = update.recording
    note = f"{recording.name}/{recording.last_frame}" if recording else ""
    return Cause("frame", note=note)


def recompile_commonsense(draft: ChangeDraft) -> None:
    """Recompile graph:commonsense: add its changes that follow from those of the ontology.

    Raises OntologyError where the ontology would be invalid.
    """
    if not any(q.graph_name == v.ONTOLOGY_GRAPH for q in (*draft.added, *draft.removed)):
        return
    old = named(draft.before(None, None, None, v.ONTOLOGY_GRAPH))
    before = compiled_before(old, set(draft.before(None, None, None, v.COMMONSENSE_GRAPH)))
    after = set(compile_commonsense(named(draft.after(None, None, None, v.ONTOLOGY_GRAPH))))
    present = set(draft.after(None, None, None, v.COMMONSENSE_GRAPH))
    delete, insert, _ = recompiled(present, before, after)
    draft.change(delete, insert)
