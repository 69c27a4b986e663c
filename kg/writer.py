"""The one writer: what should be stored against what is, and the difference as one transaction.

People write to the same graph, and the writer must neither trust yesterday's copy nor lose what
they added: what is stored is read from the store, or from a copy that ends with the first
transaction of anybody else (`kg.recent`). Predicates the writer does not use, and labels people
gave to objects, are left alone. Records are what perception believes: what was asserted is laid
over them here.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator

from pyoxigraph import Literal, NamedNode, Quad

from kg import vocabulary as v
from kg.assertions import (
    Assertions,
    Said,
    about_object,
    about_place,
    believed_object,
    believed_place,
)
from kg.commits import Cause, ChangeSet
from kg.errors import InvalidFactError
from kg.facts import Facts
from kg.floor import OWN as OWN_OF_TILES
from kg.floor import facts_of_tile, iri_of
from kg.recent import RecentFacts
from kg.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.remote import reading_ahead
from kg.right_of_way import writing
from kg.searches import OWN as OWN_OF_SEARCHES
from kg.searches import facts_of, subjects_of
from kg.store import MapStore

_MAP = NamedNode(v.MAP_GRAPH)
_DATASET = NamedNode(v.DATASET_GRAPH)
_TYPE = NamedNode(v.RDF_TYPE)
_LABEL = NamedNode(v.RDFS_LABEL)
_HAS_BELIEF = NamedNode(v.HAS_BELIEF)
_NEXT = NamedNode(v.NEXT_OBJECT)
_STRUCTURAL = {
    *(v.PLACE, v.BOT_SPACE, v.ROBOT, v.PLACE_BELIEF, v.SOSA_OBSERVATION, v.RECORDING),
    v.FLOOR_TILE,
}
_OWN = {
    *(v.RDF_TYPE, v.RDFS_LABEL, v.X, v.Y, v.Z, v.HEADING, v.IN_CELL, v.IN_PLACE),
    *(v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX, v.VIEW_COUNT, v.HAS_BELIEF, v.OF_CATEGORY, v.BELIEF),
    *(v.SCENE_BELIEF, v.TOLD_BY),
    *(v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.FIRST_SEEN, v.LAST_SEEN, v.EXPLAINED_BY),
    *(v.SOSA_FEATURE, v.SOSA_RESULT_TIME, v.FRAME, v.FROM_RECORDING, v.BOX, v.SCORE, v.MODEL),
    *(v.FRAMES_APPLIED, v.LAST_FRAME, v.TRANSFORM, v.SCENE_MODEL),
    *(v.STOREY, v.CELL_SIZE, v.FLOOR_CELLS),
}


_Quads = dict[Quad, None]  # sets in the order of their making


class Writer:
    """Applies updates to a store, and hands out object numbers that are never used twice."""

    def __init__(self, store: MapStore, facts: Facts) -> None:
        self._store = store
        self._facts = facts
        self._assertions = Assertions(facts.base)
        self._prefix = facts.base + "object/"
        self._next = 1
        self._recent = RecentFacts(store, self._owns)
        self._seen: int | None = None
        self._anything_said = True

    def new_object_iri(self) -> str:
        """The IRI of an object that is yet to be written."""
        self._store.refuse_read_only()
        number = self.next_number
        self._next = number + 1
        return f"{self._prefix}{number}"

    @property
    def next_number(self) -> int:
        """The least number that no object has had or was given."""
        return max(self._next, self._stored_next())

    def change(self, update: MapUpdate, cause: Cause) -> ChangeSet | None:
        """Make the map say what `update` says; returns the transaction.

        Raises InvalidFactError, before anything is written, where a record cannot become facts.
        """
        self._store.refuse_read_only()
        _refuse_contradictions(update)
        with writing(), reading_ahead(self._store.engine, self.subjects(update)):
            self._look()
            return self._change(update, cause)

    def _look(self) -> None:
        """Find out how the graph has changed since the last time."""
        self._seen = self._recent.catch_up()
        self._anything_said = self._assertions.any(self._store.engine)

    def _change(self, update: MapUpdate, cause: Cause) -> ChangeSet | None:
        wanted: _Quads = {}
        stored: _Quads = {}
        for record in update.objects:
            self._object(record, wanted, stored)
        for place in update.places:
            self._place(place, wanted, stored)
        if update.robot is not None:
            _put(wanted, self._facts.of_robot(update.robot))
            stored |= self._recent.of(NamedNode(self._facts.base + "robot"))
        if update.recording is not None:
            _put(wanted, self._facts.of_recording(update.recording))
            iri = self._facts.recording_iri(update.recording.name)
            _put(stored, self._owned(iri, _DATASET))
        for tile in update.floor:
            _put(wanted, facts_of_tile(self._facts.base, tile))
            held = self._recent.of(NamedNode(iri_of(self._facts.base, tile)))
            _put(stored, (quad for quad in held if quad.predicate.value in OWN_OF_TILES))
        for iri in subjects_of(update):
            _put(stored, self._owned_of_search(iri))
        _put(wanted, facts_of(update))
        for iri in update.removed:
            _put(stored, self._everything_of(iri))
        self._count_up(update.objects, wanted, stored)
        return self._commit(wanted, stored, cause)

    def restate(
        self, record: ObjectRecord | PlaceRecord, said: Said, cause: Cause
    ) -> ChangeSet | None:
        """Make `said` all that is asserted of a thing of which perception believes `record`."""
        self._look()
        wanted: _Quads = {}
        stored: _Quads = {}
        if isinstance(record, ObjectRecord):
            self._object(record, wanted, stored, said)
        else:
            self._place(record, wanted, stored, said)
        self._seen = None  # who says it may be known to the graph already
        return self._commit(wanted, stored, cause)

    def _commit(self, wanted: _Quads, stored: _Quads, cause: Cause) -> ChangeSet | None:
        deleted = [quad for quad in stored if quad not in wanted]
        inserted = [quad for quad in wanted if quad not in stored]
        if not deleted and not inserted:
            return None
        # where somebody is asserted something, facts are wanted that may be stored already
        exact = None if self._anything_said else self._seen
        change = self._store.commit(deleted, inserted, cause, exact_at=exact)
        if change is not None:
            self._recent.note(change)
        return change

    def subjects(self, update: MapUpdate) -> Iterator[NamedNode]:
        """The things whose facts `update` may change; InvalidFactError for what is no IRI."""
        objects = [*(record.iri for record in update.objects), *update.removed]
        yield from map(_node, objects)
        yield from (_node(self._facts.observation_iri(iri)) for iri in objects)
        yield from (_node(place.iri) for place in update.places)
        yield from map(_node, subjects_of(update))
        yield from (NamedNode(iri_of(self._facts.base, tile)) for tile in update.floor)
        yield NamedNode(self._facts.base)
        if update.robot is not None:
            yield NamedNode(self._facts.base + "robot")
        if update.recording is not None:
            yield NamedNode(self._facts.recording_iri(update.recording.name))

    def _object(
        self, record: ObjectRecord, wanted: _Quads, stored: _Quads, said: Said | None = None
    ) -> None:
        said_before = self._said_of(record.iri)
        said = said_before if said is None else said
        believed = believed_object(record, said)
        facts = self._facts.of_object(believed)
        node = NamedNode(record.iri)
        before = self._recent.of(node)
        labels = {quad for quad in before if quad.predicate == _LABEL}
        if (label := _asserted_label(said, said_before)) is not None:
            facts = [q for q in facts if q.predicate != _LABEL]
            facts.append(Quad(node, _LABEL, Literal(label), _MAP))
        elif (
            labels
            and "label" not in said_before
            and Quad(node, _TYPE, NamedNode(believed.category), _MAP) in before
        ):
            # the label was written when the object was new; what it says since is people's choice
            before = {quad: None for quad in before if quad not in labels}
            facts = [q for q in facts if q.predicate != _LABEL]
        _put(wanted, facts)
        stored |= before
        stored |= self._recent.of(NamedNode(self._facts.observation_iri(record.iri)))
        if said or said_before:
            _put(stored, self._assertions.stored(self._store.engine, record.iri))
            for assertion in said.values():
                about = about_object(assertion, record, time.time())
                _put(wanted, self._assertions.quads(about))

    def _place(
        self, record: PlaceRecord, wanted: _Quads, stored: _Quads, said: Said | None = None
    ) -> None:
        said_before = self._said_of(record.iri)
        said = said_before if said is None else said
        _put(wanted, self._facts.of_place(believed_place(record, said)))
        for quad in self._recent.of(NamedNode(record.iri)):
            stored[quad] = None
            if quad.predicate == _HAS_BELIEF and isinstance(quad.object, NamedNode):
                stored |= self._recent.of(quad.object)
        if "category" in said:  # also where no view has given the place a type
            kind = NamedNode(said["category"].value)
            wanted[Quad(NamedNode(record.iri), _TYPE, kind, _MAP)] = None
        if said or said_before:
            _put(stored, self._assertions.stored(self._store.engine, record.iri))
            for assertion in said.values():
                about = about_place(assertion, record, time.time())
                _put(wanted, self._assertions.quads(about))

    def _said_of(self, iri: str) -> Said:
        return self._assertions.of(self._store.engine, iri) if self._anything_said else {}

    def _owned(self, iri: str, graph: NamedNode) -> Iterator[Quad]:
        quads = self._store.engine.quads_for_pattern(NamedNode(iri), None, None, graph)
        return filter(self._owns, quads)

    def _owned_of_search(self, iri: str) -> Iterator[Quad]:
        quads = self._store.engine.quads_for_pattern(_node(iri), None, None, _MAP)
        return (quad for quad in quads if quad.predicate.value in OWN_OF_SEARCHES)

    def _owns(self, quad: Quad) -> bool:
        if quad.predicate != _TYPE:
            return quad.predicate.value in _OWN
        kind = getattr(quad.object, "value", "")
        return kind in _STRUCTURAL or self._facts.catalogue.by_iri(kind) is not None

    def _everything_of(self, iri: str) -> Iterator[Quad]:
        engine = self._store.engine
        for subject in (iri, self._facts.observation_iri(iri)):
            yield from engine.quads_for_pattern(_node(subject), None, None, _MAP)
            yield from engine.quads_for_pattern(None, None, _node(subject), _MAP)
        yield from self._assertions.stored(engine, iri)

    def _stored_next(self) -> int:
        base = NamedNode(self._facts.base)
        quads = self._store.engine.quads_for_pattern(base, _NEXT, None, _DATASET)
        return max((int(quad.object.value) for quad in quads), default=1)  # type: ignore[union-attr]

    def _count_up(self, objects: Iterable[ObjectRecord], wanted: _Quads, stored: _Quads) -> None:
        numbers = (record.iri.removeprefix(self._prefix) for record in objects)
        used = max((int(n) for n in numbers if n.isascii() and n.isdigit()), default=0)
        before = self._stored_next()
        self._next = max(self._next, before, used + 1)
        if self._next != before:
            base = NamedNode(self._facts.base)
            stored[Quad(base, _NEXT, Literal(before), _DATASET)] = None
            wanted[Quad(base, _NEXT, Literal(self._next), _DATASET)] = None


def _put(quads: _Quads, more: Iterable[Quad]) -> None:
    quads.update(dict.fromkeys(more))


def _asserted_label(said: Said, said_before: Said) -> str | None:
    if "label" in said:
        return said["label"].value
    if "label" in said_before:  # it is being retracted
        return said_before["label"].perceived
    return None


def _node(iri: str) -> NamedNode:
    try:
        return NamedNode(iri)
    except ValueError as error:
        raise InvalidFactError(f"an object's IRI must be absolute, got {iri!r}") from error


def _refuse_contradictions(update: MapUpdate) -> None:
    written = Counter(record.iri for record in update.objects)
    written.update(place.iri for place in update.places)
    written.update(subjects_of(update))
    written.update(f"floor/{t.storey}/{t.column}_{t.row}" for t in update.floor)
    for iri, times in written.items():
        if times > 1:
            raise InvalidFactError(f"{iri} is written {times} times in one update; give one record")
        if iri in update.removed:
            raise InvalidFactError(f"{iri} is both written and removed in one update; choose one")
