"""Frame writer: the difference between an update's quads and the stored ones, as one transaction.

Persons write to the same graph. Therefore the stored quads are read from the store, or from a cache
that is cleared after a transaction of another writer (`kg.maps.facts.write_cache`). The writer
keeps predicates that it does not own, and labels that persons gave to objects. Records have
perception's estimates; the writer applies assertions to them.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.assertions import (
    Assertions,
    PropertyAssertions,
    about_object,
    about_place,
    believed_object,
    believed_place,
)
from kg.maps.facts.departed_objects import OWN as OWN_OF_DEPARTED
from kg.maps.facts.departed_objects import departed_quads
from kg.maps.facts.doors import OWN as OWN_OF_DOORS
from kg.maps.facts.doors import facts_of_door
from kg.maps.facts.object_relations import OF_NODE, OF_OBJECT, SINGLE, relation_nodes
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.observations import OWN as OWN_OF_LABELS
from kg.maps.facts.observations import label_nodes
from kg.maps.facts.occupancy import OWN as OWN_OF_TILES
from kg.maps.facts.occupancy import facts_of_tile, iri_of
from kg.maps.facts.robot_and_recordings import recording_iri, recording_quads, robot_quads
from kg.maps.facts.searches import OWN as OWN_OF_SEARCHES
from kg.maps.facts.searches import facts_of, subjects_of
from kg.maps.facts.write_cache import WriteCache
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.iris import observation_iri, whole_number
from kg.model.records import DepartedRecord, MapUpdate, ObjectRecord, PlaceRecord
from kg.model.transactions import Cause, ChangeSet
from kg.store.transactional import TransactionalStore
from kg.store.write_limit import check_time
from kg.store.writer_priority import writing

_LABEL = NamedNode(v.RDFS_LABEL)
_HAS_BELIEF = NamedNode(v.HAS_BELIEF)
_LINKS = (NamedNode(v.HAS_RELATION), NamedNode(v.HAS_LABEL_BELIEF))  # to parts of an object
_NEXT = NamedNode(v.NEXT_OBJECT)
_STRUCTURAL = {
    *(v.PLACE, v.BOT_SPACE, v.ROBOT, v.PLACE_BELIEF, v.SOSA_OBSERVATION, v.RECORDING),
    *(v.FLOOR_TILE, v.DOOR, v.SPATIAL_RELATION, v.LABEL_BELIEF, v.DEPARTED_OBJECT),
}
_OWN = {
    *(v.RDF_TYPE.value, v.RDFS_LABEL, v.X, v.Y, v.Z, v.HEADING, v.IN_CELL, v.IN_PLACE),
    *(v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX, v.VIEW_COUNT, v.HAS_BELIEF, v.OF_CATEGORY, v.BELIEF),
    *(v.OUTLINE, v.FROM_FLOOR, v.BOT_ADJACENT_ZONE, v.WIDTH, v.BOT_INTERFACE_OF),
    *(v.VIEWED_SHARE, v.CLOSELY_VIEWED_SHARE, v.LAST_VIEWED),
    *(v.SCENE_BELIEF, v.TOLD_BY),
    *(v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.FIRST_SEEN, v.LAST_SEEN, v.EXPLAINED_BY),
    *(v.EXTENT_X, v.EXTENT_Y, v.EXTENT_Z, v.YAW, v.DEVIATION),
    *(v.SOSA_FEATURE, v.SOSA_RESULT_TIME, v.FRAME, v.FROM_RECORDING, v.BOX, v.SCORE, v.MODEL),
    *(v.FRAMES_APPLIED, v.LAST_FRAME, v.TRANSFORM, v.SCENE_MODEL, v.DETECTS),
    *(v.STOREY, v.CELL_SIZE, v.FLOOR_CELLS, v.VIEW_TIMES, *OF_OBJECT, *OF_NODE),
    *OWN_OF_LABELS,
    *OWN_OF_DEPARTED,
}


@dataclass(slots=True)
class _Draft:
    """Quads of an update before the comparison; dicts serve as ordered sets."""

    wanted: dict[Quad, None] = field(default_factory=dict)  # quads after the update
    stored: dict[Quad, None] = field(default_factory=dict)  # quads that the update replaces

    def want(self, quads: Iterable[Quad]) -> None:
        """Add quads that hold after the update."""
        self.wanted.update(dict.fromkeys(quads))

    def replace(self, quads: Iterable[Quad]) -> None:
        """Add stored quads, which are deleted unless they are wanted."""
        self.stored.update(dict.fromkeys(quads))


class FrameWriter:
    """Writer of updates to a store; it allocates object numbers, each used once."""

    def __init__(self, store: TransactionalStore, facts: RecordCodec) -> None:
        self._store = store
        self._facts = facts
        self._assertions = Assertions(facts.base)
        self._prefix = facts.base + "object/"
        self._next = 1
        self._recent = WriteCache(store, self._owns)
        self._synchronised_at: int | None = None
        self._has_assertions = True

    def new_object_iri(self) -> str:
        """A fresh IRI for a new object."""
        self._store.check_writable()
        number = self.next_number
        self._next = number + 1
        return f"{self._prefix}{number}"

    @property
    def next_number(self) -> int:
        """The smallest object number that was never allocated."""
        return max(self._next, self._stored_next())

    def change(
        self,
        update: MapUpdate,
        cause: Cause,
        asserted: Mapping[str, PropertyAssertions] | None = None,
    ) -> ChangeSet | None:
        """Apply `update` to the map; returns the transaction.

        `asserted` has assertions of places by IRI, which replace the stored ones.
        Raises InvalidFactError, before anything is written, for a record that is not valid.
        """
        self._store.check_writable()
        _check_unique(update)
        with writing():
            self._synchronise()
            if asserted:
                self._has_assertions = True
            return self._change(update, cause, asserted or {})

    def _synchronise(self) -> None:
        """Synchronise the write cache with the graph."""
        self._synchronised_at = self._recent.catch_up()
        self._has_assertions = self._assertions.any(self._store.engine)

    def _change(
        self, update: MapUpdate, cause: Cause, asserted: Mapping[str, PropertyAssertions]
    ) -> ChangeSet | None:
        draft = _Draft()
        for record in update.objects:
            check_time()
            kept = self._assertions_of(record.iri, without=update.removed)
            self._object(record, draft, kept)
        for place in update.places:
            check_time()
            self._place(place, draft, asserted.get(place.iri))
        self._doors_and_floor(update, draft)
        self._robot_and_recording(update, draft)
        self._searches(update, draft)
        for iri in update.removed:
            check_time()
            draft.replace(self.all_quads_of(iri))
        for departed in update.departed:
            self._departed(departed, draft)
        self._advance_number(update.objects, draft)
        return self._commit(draft, cause)

    def _doors_and_floor(self, update: MapUpdate, draft: _Draft) -> None:
        for door in update.doors:
            draft.want(facts_of_door(door))
            draft.replace(_with(OWN_OF_DOORS, self._recent.of(_node(door.iri))))
        for tile in update.floor:
            check_time()
            draft.want(facts_of_tile(self._facts.base, tile))
            node = NamedNode(iri_of(self._facts.base, tile))
            draft.replace(_with(OWN_OF_TILES, self._recent.of(node)))

    def _robot_and_recording(self, update: MapUpdate, draft: _Draft) -> None:
        if update.robot is not None:
            draft.want(robot_quads(update.robot, self._facts.base))
            draft.replace(self._recent.of(NamedNode(self._facts.base + "robot")))
        if update.recording is not None:
            draft.want(recording_quads(update.recording, self._facts.base))
            recording = NamedNode(recording_iri(update.recording.name, self._facts.base))
            quads = self._store.engine.quads_for_pattern(recording, None, None, v.DATASET_GRAPH)
            draft.replace(filter(self._owns, quads))

    def _searches(self, update: MapUpdate, draft: _Draft) -> None:
        draft.want(facts_of(update))
        for iri in subjects_of(update):
            quads = self._store.engine.quads_for_pattern(_node(iri), None, None, v.MAP_GRAPH)
            draft.replace(_with(OWN_OF_SEARCHES, quads))

    def restate(
        self, record: ObjectRecord | PlaceRecord, assertions: PropertyAssertions, cause: Cause
    ) -> ChangeSet | None:
        """Replace the assertions about an object or place; `record` is perception's estimate."""
        return self._commit(self._restated(((record, assertions),)), cause)

    def restatement(
        self, asserted: Iterable[tuple[ObjectRecord | PlaceRecord, PropertyAssertions]]
    ) -> tuple[tuple[Quad, ...], tuple[Quad, ...]]:
        """Quads to delete and to insert so that each subject has exactly the given assertions."""
        draft = self._restated(asserted)
        return tuple(draft.stored), tuple(draft.wanted)

    def _restated(
        self, asserted: Iterable[tuple[ObjectRecord | PlaceRecord, PropertyAssertions]]
    ) -> _Draft:
        self._synchronise()
        draft = _Draft()
        for record, assertions in asserted:
            check_time()
            if isinstance(record, ObjectRecord):
                self._object(record, draft, assertions)
            else:
                self._place(record, draft, assertions)
        self._synchronised_at = None  # quads of the author may be stored already
        return draft

    def _commit(self, draft: _Draft, cause: Cause) -> ChangeSet | None:
        deleted = [quad for quad in draft.stored if quad not in draft.wanted]
        inserted = [quad for quad in draft.wanted if quad not in draft.stored]
        if not deleted and not inserted:
            return None
        # with assertions present, some wanted quads may be stored already
        exact = None if self._has_assertions else self._synchronised_at
        change = self._store.commit(deleted, inserted, cause, exact_at=exact)
        if change is not None:
            self._recent.note(change)
        return change

    def subjects(self, update: MapUpdate) -> Iterator[NamedNode]:
        """Subjects whose quads `update` may change; raises InvalidFactError for an invalid IRI."""
        objects = [*(record.iri for record in update.objects), *update.removed]
        yield from map(_node, objects)
        yield from (_node(observation_iri(self._facts.base, iri)) for iri in objects)
        yield from (_node(place.iri) for place in update.places)
        yield from (_node(door.iri) for door in update.doors)
        yield from map(_node, subjects_of(update))
        yield from (NamedNode(iri_of(self._facts.base, tile)) for tile in update.floor)
        yield NamedNode(self._facts.base)
        if update.robot is not None:
            yield NamedNode(self._facts.base + "robot")
        if update.recording is not None:
            yield NamedNode(recording_iri(update.recording.name, self._facts.base))

    def _object(
        self,
        record: ObjectRecord,
        draft: _Draft,
        assertions: PropertyAssertions,
    ) -> None:
        previous = self._assertions_of(record.iri)
        believed = believed_object(record, assertions)
        facts = self._facts.of_object(believed)
        node = NamedNode(record.iri)
        before = self._with_parts(node, record)
        labels = {quad for quad in before if quad.predicate == _LABEL}
        if (label := _asserted_label(assertions, previous)) is not None:
            facts = [q for q in facts if q.predicate != _LABEL]
            facts.append(Quad(node, _LABEL, Literal(label), v.MAP_GRAPH))
        elif labels and "label" not in previous and _kind(node, believed.category) & before.keys():
            # a label is written once, for a new object: persons may have edited it since
            before = {quad: None for quad in before if quad not in labels}
            facts = [q for q in facts if q.predicate != _LABEL]
        draft.want(facts)
        draft.replace(before)
        draft.replace(self._recent.of(NamedNode(observation_iri(self._facts.base, record.iri))))
        if assertions or previous:
            draft.replace(self._assertions.stored(self._store.engine, record.iri))
            for assertion in assertions.values():
                about = about_object(assertion, record, time.time())
                draft.want(self._assertions.quads(about))

    def _departed(self, record: DepartedRecord, draft: _Draft) -> None:
        """Facts of a departed object, with its former label."""
        self._facts.known_category(record.category, f"departed object {record.iri}", "object")
        draft.want(departed_quads(record))
        node = NamedNode(record.iri)
        labels = [q for q in draft.stored if q.subject == node and q.predicate == _LABEL]
        own = Quad(node, _LABEL, Literal(self._facts.object_label(record)), v.MAP_GRAPH)
        draft.want(labels or [own])

    def _place(
        self,
        record: PlaceRecord,
        draft: _Draft,
        assertions: PropertyAssertions | None = None,
    ) -> None:
        previous = self._assertions_of(record.iri)
        assertions = previous if assertions is None else assertions
        draft.want(self._facts.of_place(believed_place(record, assertions)))
        for quad in self._recent.of(NamedNode(record.iri)):
            draft.replace([quad])
            if quad.predicate == _HAS_BELIEF and isinstance(quad.object, NamedNode):
                draft.replace(self._recent.of(quad.object))
        if "category" in assertions:  # even if no view has given the place a type yet
            kind = NamedNode(assertions["category"].value)
            draft.want([Quad(NamedNode(record.iri), v.RDF_TYPE, kind, v.MAP_GRAPH)])
        if assertions or previous:
            draft.replace(self._assertions.stored(self._store.engine, record.iri))
            for assertion in assertions.values():
                about = about_place(assertion, record, time.time())
                draft.want(self._assertions.quads(about))

    def _with_parts(self, node: NamedNode, record: ObjectRecord) -> dict[Quad, None]:
        """Stored facts that `record` replaces: of the object, its relations and alternatives."""
        before = self._recent.of(node)
        if record.relations is None:
            before = {quad: None for quad in before if quad.predicate.value not in OF_OBJECT}
        for quad in tuple(before):
            if quad.predicate in _LINKS and isinstance(quad.object, NamedNode):
                before = before | self._recent.of(quad.object)
        return before

    def _assertions_of(self, iri: str, without: Collection[str] = ()) -> PropertyAssertions:
        """Assertions of a thing, except relations to the things in `without`."""
        if not self._has_assertions:
            return {}
        assertions = self._assertions.of(self._store.engine, iri)
        return {p: a for p, a in assertions.items() if p not in SINGLE or a.value not in without}

    def _owns(self, quad: Quad) -> bool:
        if quad.predicate != v.RDF_TYPE:
            return quad.predicate.value in _OWN
        kind = getattr(quad.object, "value", "")
        return kind in _STRUCTURAL or self._facts.catalogue.by_iri(kind) is not None

    def all_quads_of(self, iri: str) -> Iterator[Quad]:
        """All quads of an object: its facts, observation, assertions and links to it."""
        engine = self._store.engine
        for node in label_nodes(engine, iri):
            yield from engine.quads_for_pattern(node, None, None, v.MAP_GRAPH)
        for subject in (iri, observation_iri(self._facts.base, iri), *relation_nodes(engine, iri)):
            yield from engine.quads_for_pattern(_node(subject), None, None, v.MAP_GRAPH)
            yield from engine.quads_for_pattern(None, None, _node(subject), v.MAP_GRAPH)
            for quad in engine.quads_for_pattern(_node(subject), _HAS_BELIEF, None, v.MAP_GRAPH):
                if isinstance(quad.object, NamedNode):
                    yield from engine.quads_for_pattern(quad.object, None, None, v.MAP_GRAPH)
        yield from self._assertions.stored(engine, iri)
        yield from self._assertions.naming(engine, iri)

    def _stored_next(self) -> int:
        base = NamedNode(self._facts.base)
        quads = self._store.engine.quads_for_pattern(base, _NEXT, None, v.DATASET_GRAPH)
        return max((int(quad.object.value) for quad in quads), default=1)  # type: ignore[union-attr]

    def _advance_number(self, objects: Iterable[ObjectRecord], draft: _Draft) -> None:
        numbers = (record.iri.removeprefix(self._prefix) for record in objects)
        used = max((whole_number(n) or 0 for n in numbers), default=0)
        before = self._stored_next()
        self._next = max(self._next, before, used + 1)
        if self._next != before:
            base = NamedNode(self._facts.base)
            draft.replace([Quad(base, _NEXT, Literal(before), v.DATASET_GRAPH)])
            draft.want([Quad(base, _NEXT, Literal(self._next), v.DATASET_GRAPH)])


def _with(predicates: Collection[str], quads: Iterable[Quad]) -> Iterator[Quad]:
    return (quad for quad in quads if quad.predicate.value in predicates)


def _kind(node: NamedNode, category: str) -> set[Quad]:
    """Facts of the category of an object or of a departed object."""
    kind = NamedNode(category)
    return {
        Quad(node, v.RDF_TYPE, kind, v.MAP_GRAPH),
        Quad(node, NamedNode(v.OF_CATEGORY), kind, v.MAP_GRAPH),
    }


def _asserted_label(assertions: PropertyAssertions, previous: PropertyAssertions) -> str | None:
    if "label" in assertions:
        return assertions["label"].value
    if "label" in previous:  # the assertion is being retracted
        return previous["label"].perceived
    return None


def _node(iri: str) -> NamedNode:
    try:
        return NamedNode(iri)
    except ValueError as error:
        raise InvalidFactError(f"an object's IRI must be absolute, got {iri!r}") from error


def _check_unique(update: MapUpdate) -> None:
    written = Counter(record.iri for record in update.objects)
    written.update(place.iri for place in update.places)
    written.update(door.iri for door in update.doors)
    written.update(subjects_of(update))
    written.update(f"floor/{t.storey}/{t.column}_{t.row}" for t in update.floor)
    for iri, times in written.items():
        if times > 1:
            raise InvalidFactError(f"{iri} is written {times} times in one update; give one record")
        if iri in update.removed:
            raise InvalidFactError(f"{iri} is both written and removed in one update; choose one")
    for iri, times in Counter(record.iri for record in update.departed).items():
        if times > 1 or iri not in update.removed:
            raise InvalidFactError(f"{iri} departed: give it once, and in `removed` too")
