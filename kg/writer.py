"""The one writer: what should be stored against what is, and the difference as one transaction.

What is stored is read from the store each time (60 microseconds a subject), never remembered:
people write to the same graph, and the writer must neither trust yesterday's copy nor lose what
they added. Predicates the writer does not use, and labels people gave to objects, are left alone.
Records are what perception believes: what was asserted is laid over them here.
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
from kg.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.remote import reading_ahead
from kg.store import MapStore

_MAP = NamedNode(v.MAP_GRAPH)
_DATASET = NamedNode(v.DATASET_GRAPH)
_TYPE = NamedNode(v.RDF_TYPE)
_LABEL = NamedNode(v.RDFS_LABEL)
_HAS_BELIEF = NamedNode(v.HAS_BELIEF)
_NEXT = NamedNode(v.NEXT_OBJECT)
_STRUCTURAL = {v.PLACE, v.BOT_SPACE, v.ROBOT, v.PLACE_BELIEF, v.SOSA_OBSERVATION, v.RECORDING}
_OWN = {
    *(v.RDF_TYPE, v.RDFS_LABEL, v.X, v.Y, v.Z, v.HEADING, v.IN_CELL, v.IN_PLACE),
    *(v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX, v.VIEW_COUNT, v.HAS_BELIEF, v.OF_CATEGORY, v.BELIEF),
    *(v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.FIRST_SEEN, v.LAST_SEEN, v.EXPLAINED_BY),
    *(v.SOSA_FEATURE, v.SOSA_RESULT_TIME, v.FRAME, v.FROM_RECORDING, v.BOX, v.SCORE, v.MODEL),
    *(v.FRAMES_APPLIED, v.LAST_FRAME, v.TRANSFORM, v.SCENE_MODEL),
}


class Writer:
    """Applies updates to a store, and hands out object numbers that are never used twice."""

    def __init__(self, store: MapStore, facts: Facts) -> None:
        self._store = store
        self._facts = facts
        self._assertions = Assertions(facts.base)
        self._prefix = facts.base + "object/"
        self._next = 1

    def new_object_iri(self) -> str:
        """The IRI of an object that is yet to be written."""
        self._store.refuse_read_only()
        number = max(self._next, self._stored_next())
        self._next = number + 1
        return f"{self._prefix}{number}"

    def apply(self, update: MapUpdate, cause: Cause) -> int:
        """Make the map say what `update` says; returns how many triples changed.

        Raises InvalidFactError, before anything is written, where a record cannot become facts.
        """
        change = self.change(update, cause)
        return len(change) if change else 0

    def change(self, update: MapUpdate, cause: Cause) -> ChangeSet | None:
        """As `apply`; returns the transaction."""
        self._store.refuse_read_only()
        _refuse_contradictions(update)
        with reading_ahead(self._store.engine, self._read_by(update)):
            return self._change(update, cause)

    def _change(self, update: MapUpdate, cause: Cause) -> ChangeSet | None:
        wanted: set[Quad] = set()
        stored: set[Quad] = set()
        for record in update.objects:
            self._object(record, wanted, stored)
        for place in update.places:
            self._place(place, wanted, stored)
        if update.robot is not None:
            wanted.update(self._facts.of_robot(update.robot))
            stored.update(self._owned(self._facts.base + "robot", _MAP))
        if update.recording is not None:
            wanted.update(self._facts.of_recording(update.recording))
            iri = self._facts.recording_iri(update.recording.name)
            stored.update(self._owned(iri, _DATASET))
        for iri in update.removed:
            stored.update(self._everything_of(iri))
        self._count_up(update.objects, wanted, stored)
        return self._commit(wanted, stored, cause)

    def restate(
        self, record: ObjectRecord | PlaceRecord, said: Said, cause: Cause
    ) -> ChangeSet | None:
        """Make `said` all that is asserted of a thing of which perception believes `record`."""
        wanted: set[Quad] = set()
        stored: set[Quad] = set()
        if isinstance(record, ObjectRecord):
            self._object(record, wanted, stored, said)
        else:
            self._place(record, wanted, stored, said)
        return self._commit(wanted, stored, cause)

    def _commit(self, wanted: set[Quad], stored: set[Quad], cause: Cause) -> ChangeSet | None:
        deleted, inserted = stored - wanted, wanted - stored
        if not deleted and not inserted:
            return None
        return self._store.commit(sorted(deleted, key=str), sorted(inserted, key=str), cause)

    def _read_by(self, update: MapUpdate) -> Iterator[NamedNode]:
        objects = [*(record.iri for record in update.objects), *update.removed]
        yield from map(_node, objects)
        yield from (_node(self._facts.observation_iri(iri)) for iri in objects)
        yield from (_node(place.iri) for place in update.places)
        yield NamedNode(self._facts.base)
        if update.robot is not None:
            yield NamedNode(self._facts.base + "robot")
        if update.recording is not None:
            yield NamedNode(self._facts.recording_iri(update.recording.name))

    def _object(
        self, record: ObjectRecord, wanted: set[Quad], stored: set[Quad], said: Said | None = None
    ) -> None:
        said_before = self._assertions.of(self._store.engine, record.iri)
        said = said_before if said is None else said
        believed = believed_object(record, said)
        facts = self._facts.of_object(believed)
        before = set(self._owned(record.iri, _MAP))
        labels = {quad for quad in before if quad.predicate == _LABEL}
        if (label := _asserted_label(said, said_before)) is not None:
            facts = [q for q in facts if q.predicate != _LABEL]
            facts.append(Quad(NamedNode(record.iri), _LABEL, Literal(label), _MAP))
        elif (
            labels
            and "label" not in said_before
            and Quad(NamedNode(record.iri), _TYPE, NamedNode(believed.category), _MAP) in before
        ):
            # the label was written when the object was new; what it says since is people's choice
            before -= labels
            facts = [q for q in facts if q.predicate != _LABEL]
        wanted.update(facts)
        stored |= before
        stored.update(self._owned(self._facts.observation_iri(record.iri), _MAP))
        if said or said_before:
            stored.update(self._assertions.stored(self._store.engine, record.iri))
            for assertion in said.values():
                about = about_object(assertion, record, time.time())
                wanted.update(self._assertions.quads(about))

    def _place(
        self, record: PlaceRecord, wanted: set[Quad], stored: set[Quad], said: Said | None = None
    ) -> None:
        said_before = self._assertions.of(self._store.engine, record.iri)
        said = said_before if said is None else said
        wanted.update(self._facts.of_place(believed_place(record, said)))
        for quad in self._owned(record.iri, _MAP):
            stored.add(quad)
            if quad.predicate == _HAS_BELIEF and isinstance(quad.object, NamedNode):
                stored.update(self._owned(quad.object.value, _MAP))
        if "category" in said:  # also where no view has given the place a type
            kind = NamedNode(said["category"].value)
            wanted.add(Quad(NamedNode(record.iri), _TYPE, kind, _MAP))
        if said or said_before:
            stored.update(self._assertions.stored(self._store.engine, record.iri))
            for assertion in said.values():
                about = about_place(assertion, record, time.time())
                wanted.update(self._assertions.quads(about))

    def _owned(self, iri: str, graph: NamedNode) -> Iterator[Quad]:
        for quad in self._store.engine.quads_for_pattern(NamedNode(iri), None, None, graph):
            if quad.predicate.value not in _OWN:
                continue
            if quad.predicate != _TYPE or self._own_type(getattr(quad.object, "value", "")):
                yield quad

    def _own_type(self, iri: str) -> bool:
        return iri in _STRUCTURAL or self._facts.catalogue.by_iri(iri) is not None

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

    def _count_up(
        self, objects: Iterable[ObjectRecord], wanted: set[Quad], stored: set[Quad]
    ) -> None:
        numbers = (record.iri.removeprefix(self._prefix) for record in objects)
        used = max((int(n) for n in numbers if n.isascii() and n.isdigit()), default=0)
        before = self._stored_next()
        self._next = max(self._next, before, used + 1)
        if self._next != before:
            base = NamedNode(self._facts.base)
            stored.add(Quad(base, _NEXT, Literal(before), _DATASET))
            wanted.add(Quad(base, _NEXT, Literal(self._next), _DATASET))


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
    for iri, times in written.items():
        if times > 1:
            raise InvalidFactError(f"{iri} is written {times} times in one update; give one record")
        if iri in update.removed:
            raise InvalidFactError(f"{iri} is both written and removed in one update; choose one")
