"""Frame writer: the difference between an update's quads and the stored ones, as one transaction.

Persons write to the same graph. Therefore the stored quads are read from the store, or from a cache
that is cleared after a transaction of another writer (`kg.maps.facts.write_cache`). The writer
keeps predicates that it does not own, and labels that persons gave to objects. Records have
perception's estimates; the writer applies assertions to them.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.assertions import (
    Assertions,
    PropertyAssertions,
    believed_object,
    believed_place,
    compared,
)
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.observations import departed_quads, label_nodes
from kg.maps.facts.occupancy import facts_of_tile, iri_of
from kg.maps.facts.robot import (
    facts_of_look,
    facts_of_obstacle,
    facts_of_search,
    recording_iri,
    recording_quads,
    robot_quads,
)
from kg.maps.facts.spatial_relations import OF_OBJECT, SINGLE, facts_of_door, relation_nodes
from kg.maps.facts.write_cache import WriteCache, is_owned
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.iris import observation_iri, whole_number
from kg.model.records import DepartedRecord, MapUpdate, ObjectRecord, PlaceRecord
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import iri_node
from kg.store.scheduling import check_time, writing
from kg.store.transactional import TransactionalStore

_LABEL = NamedNode(v.RDFS_LABEL)
_HAS_BELIEF = NamedNode(v.HAS_BELIEF)
_LINKS = (NamedNode(v.HAS_RELATION), NamedNode(v.HAS_LABEL_BELIEF))  # to parts of an object
_PARTS = {v.HAS_LABEL_BELIEF, v.HAS_RELATION, *OF_OBJECT}
_NEXT = NamedNode(v.NEXT_OBJECT)
#: of other things, beside the predicates that they always have
_OPTIONAL = {v.PROV_ENDED_AT, v.FOUND, v.GLIMPSES, v.VIEW_TIMES, v.SCENE_MODEL, v.DETECTS}


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
        _check_unique(update, (iri for iri, _ in self._single_things(update)))
        with writing():
            self._synchronise()
            self._has_assertions |= bool(asserted)
            return self._commit(self._draft(update, asserted or {}), cause)

    def _synchronise(self) -> None:
        """Synchronise the write cache with the graph."""
        self._synchronised_at = self._recent.catch_up()
        self._has_assertions = self._assertions.any(self._store.engine)

    def _draft(self, update: MapUpdate, asserted: Mapping[str, PropertyAssertions]) -> _Draft:
        draft = _Draft()
        for record in update.objects:
            check_time()
            kept = self._assertions_of(record.iri, without=update.removed)
            self._object(record, draft, kept)
        for place in update.places:
            check_time()
            self._place(place, draft, asserted.get(place.iri))
        for _, facts in self._single_things(update):
            check_time()
            self._replace(facts(), draft)
        if update.recording is not None:
            self._replace(recording_quads(update.recording, self._facts.base), draft)
        for iri in update.removed:
            check_time()
            draft.replace(self.all_quads_of(iri))
        for departed in update.departed:
            self._departed(departed, draft)
        self._advance_number(update.objects, draft)
        return draft

    def _single_things(self, update: MapUpdate) -> Iterator[tuple[str, Callable[[], list[Quad]]]]:
        """IRIs and facts of what has no parts and no assertions: doors, floor, robot, searches.

        Without the recording, which may have the IRI of a search.
        """
        base = self._facts.base
        yield from ((door.iri, partial(facts_of_door, door)) for door in update.doors)
        yield from ((iri_of(base, one), partial(facts_of_tile, base, one)) for one in update.floor)
        if update.robot is not None:
            yield base + "robot", partial(robot_quads, update.robot, base)
        if update.search is not None:
            yield update.search.iri, partial(facts_of_search, update.search)
        yield from ((look.iri, partial(facts_of_look, look)) for look in update.looks)
        yield from ((one.iri, partial(facts_of_obstacle, one)) for one in update.obstacles)

    def _replace(self, facts: list[Quad], draft: _Draft) -> None:
        """Replace the stored facts of one subject by `facts`, whose predicates the writer owns."""
        owned = {quad.predicate.value for quad in facts} | _OPTIONAL
        draft.want(facts)
        subject, graph = facts[0].subject, facts[0].graph_name
        for quad in self._store.engine.quads_for_pattern(subject, None, None, graph):
            if quad.predicate.value in owned and (quad.predicate != v.RDF_TYPE or self._owns(quad)):
                draft.replace([quad])

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
        single = (iri for iri, _ in self._single_things(update))
        places = (place.iri for place in update.places)
        observations = (observation_iri(self._facts.base, iri) for iri in objects)
        for iri in (*objects, *observations, *places, *single, self._facts.base):
            yield iri_node(iri, "a thing")
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
        self._state(record, assertions, previous, draft)

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
        self._state(record, assertions, previous, draft)

    def _state(
        self,
        record: ObjectRecord | PlaceRecord,
        assertions: PropertyAssertions,
        previous: PropertyAssertions,
        draft: _Draft,
    ) -> None:
        """Replace the `previous` assertions about a thing, with perception's present estimate."""
        if assertions or previous:
            draft.replace(self._assertions.stored(self._store.engine, record.iri))
        for assertion in assertions.values():
            draft.want(self._assertions.quads(compared(assertion, record, time.time())))

    def _with_parts(self, node: NamedNode, record: ObjectRecord) -> dict[Quad, None]:
        """Stored facts that `record` replaces: of the object, its relations and alternatives."""
        before = self._recent.of(node)
        if _PARTS.isdisjoint([quad.predicate.value for quad in before]):
            return before
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
        return is_owned(quad, self._facts)

    def all_quads_of(self, iri: str) -> Iterator[Quad]:
        """All quads of an object: its facts, observation, assertions and links to it."""
        engine = self._store.engine
        for node in label_nodes(engine, iri):
            yield from engine.quads_for_pattern(node, None, None, v.MAP_GRAPH)
        for subject in (iri, observation_iri(self._facts.base, iri), *relation_nodes(engine, iri)):
            node = iri_node(subject, "a thing")
            yield from engine.quads_for_pattern(node, None, None, v.MAP_GRAPH)
            yield from engine.quads_for_pattern(None, None, node, v.MAP_GRAPH)
            for quad in engine.quads_for_pattern(node, _HAS_BELIEF, None, v.MAP_GRAPH):
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


def _check_unique(update: MapUpdate, single: Iterable[str]) -> None:
    """Raise InvalidFactError for things, such as the `single` ones (IRIs), that occur twice."""
    objects, places = (one.iri for one in update.objects), (one.iri for one in update.places)
    written = Counter((*objects, *places, *single))
    for iri, times in written.items():
        if times > 1:
            raise InvalidFactError(f"{iri} is written {times} times in one update; give one record")
        if iri in update.removed:
            raise InvalidFactError(f"{iri} is both written and removed in one update; choose one")
    for iri, times in Counter(record.iri for record in update.departed).items():
        if times > 1 or iri not in update.removed:
            raise InvalidFactError(f"{iri} departed: give it once, and in `removed` too")
