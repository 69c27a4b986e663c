"""Assertion service: persons assert and retract properties of objects and places."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from pyoxigraph import NamedNode, Quad

from kg.maps.facts.assertions import (
    NAME,
    PROPERTIES,
    Assertions,
    PropertyAssertions,
    area_text,
    believed_object,
    kept_property,
    perceived_object,
    perceived_place,
    point,
    value_of,
)
from kg.maps.facts.frame_writer import FrameWriter
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.replaced_values import ago, noted, shown_value
from kg.maps.facts.spatial_relations import NOTHING, SINGLE
from kg.maps.map_extent import check_positions, check_sides
from kg.maps.stored_history import StoredHistory
from kg.maps.thing_names import category_of_name, checked_line, checked_name
from kg.model.errors import (
    HereaboutsError,
    InvalidFactError,
    QueryParameterError,
    did_you_mean,
)
from kg.model.records import Assertion, MapUpdate, ObjectRecord, PlaceRecord
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import area_of_polygon
from kg.store.scheduling import WriterLock
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    from kg.history.reports.events import HistoryEvent


class PerceivedRecords:
    """Objects and places of the map in `store` as perception alone estimates them."""

    def __init__(self, store: TransactionalStore, facts: RecordCodec) -> None:
        self._store, self._facts = store, facts
        self._assertions = Assertions(facts.base)

    def objects(self, iris: Iterable[str] | None = None) -> tuple[ObjectRecord, ...]:
        """Objects, oldest first; all where `iris` is None."""
        engine, facts = self._store.engine, self._facts
        found = facts.objects(engine) if iris is None else facts.some_objects(engine, iris)
        asserted = self._by_subject()
        return tuple(perceived_object(record, asserted.get(record.iri, {})) for record in found)

    def places(self) -> tuple[PlaceRecord, ...]:
        """Places, by number."""
        asserted = self._by_subject()
        found = self._facts.places(self._store.engine)
        return tuple(perceived_place(record, asserted.get(record.iri, {})) for record in found)

    def _by_subject(self) -> Mapping[str, dict[str, Assertion]]:
        asserted: dict[str, dict[str, Assertion]] = {}
        for assertion in self._assertions.all(self._store.engine):
            asserted.setdefault(assertion.subject, {})[assertion.property] = assertion
        return asserted


class NamedCategories(Protocol):
    """Categories with the names that people give things."""

    def category_named(self, name: str, by: str) -> str:
        """IRI of the category with that name; a new one is added."""

    def forget_name(self, iri: str, by: str | None) -> None:
        """Remove a category that was added so, where nothing refers to it any more."""


class AssertionService:
    """Assertions of one map, made and retracted; each call is one transaction under `guard`.

    `writer` and `names` are asked for once something is written.
    """

    def __init__(
        self,
        store: TransactionalStore,
        facts: RecordCodec,
        perceived: PerceivedRecords,
        writer: Callable[[], FrameWriter],
        guard: WriterLock,
        names: Callable[[], NamedCategories],
        history: StoredHistory,
        resolve: Callable[[str, str], str],
    ) -> None:
        self._history, self._resolve = history, resolve
        self._store, self._facts, self._perceived = store, facts, perceived
        self._writer, self._guard, self._names = writer, guard, names
        self._assertions = Assertions(facts.base)

    def all(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """The assertions about one subject, or about all."""
        if iri is None:
            return self._assertions.all(self._store.engine)
        return tuple(self._of(self.full(iri)).values())

    def conflicts(self) -> tuple[Assertion, ...]:
        """The assertions that perception contradicts."""
        return tuple(assertion for assertion in self.all() if assertion.since is not None)

    def add(self, iri: str, prop: str, value: object, *, by: str = "") -> ChangeSet | None:
        """Assert `prop` of an object or place; it overrides the estimates of perception.

        A name is the label as well, as it is given; of a place it is the label alone. The notes of
        the transaction tell of values of other people that it replaces, and of a position that is
        odd. Raises InvalidFactError.
        """
        if not by.strip():
            raise InvalidFactError("an assertion needs an author: by='ann'")
        by = checked_line(by, "an author", "ann")
        if isinstance(value, list) and prop not in ("position", "extent"):
            raise InvalidFactError(f"the {prop} of a thing is a text, got {f'{value}'[:100]}")
        with self._guard:
            record = self._record(self.full(iri))
            kind = "object" if isinstance(record, ObjectRecord) else "place"
            name = ""
            if kind == "object" and prop == NAME:
                name = checked_name(str(value))
                value = self._names().category_named(name, by.strip())
            prop = kept_property(prop, record.iri)
            if kind == "object" and prop in SINGLE:
                text = self._related_object(record.iri, prop, value)
            else:
                text = value_of(prop, value, self._facts.catalogue, kind)
            odd = self._position_checked(record, prop, text)
            asserted = self._of(record.iri)
            made = {prop: self.made(record, asserted, prop, text, by)}
            if name and (
                "label" in asserted or self._facts.catalogue.title(text, record.iri) != name
            ):
                made["label"] = self.made(record, asserted, "label", name, by)
                made["label"] = replace(made["label"], stamp=made[prop].stamp)
            cause = Cause("assert", by, f"{record.iri} {prop} {text}")
            change = self._restate(record, {**asserted, **made}, cause)
            change = noted(change, self._facts.base, self._facts.catalogue, odd)
            self._forget_name(asserted.get(prop), by)
            return change

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Retract the assertion of `prop`: the estimate of perception takes effect again.

        A name and its label go together. Raises InvalidFactError where nothing is asserted, and
        where somebody else's assertion has replaced that of `by`.
        """
        by = None if by is None else checked_line(by, "an author", "ann")
        with self._guard:
            record = self._record(self.full(iri, "asserted"))
            asserted = self._of(record.iri)
            prop = kept_property(prop, record.iri)
            if prop not in asserted:
                hint = "" if prop in PROPERTIES else did_you_mean(prop, PROPERTIES)
                raise InvalidFactError(
                    f"the {prop} of {record.iri.removeprefix(self._facts.base)} is not asserted; "
                    f"asserted of it: {', '.join(sorted(asserted)) or 'nothing'}{hint}"
                )
            if by is not None and asserted[prop].by != by:
                self._check_not_replaced(asserted[prop], by)
            cause = Cause("retract", by, f"{record.iri} {prop}")
            gone = asserted[prop]
            rest = {k: a for k, a in asserted.items() if k != prop and not self._is_pair(gone, a)}
            if isinstance(record, PlaceRecord) and prop == "area" and gone.perceived:
                record = record.with_area(area_of_polygon(gone.perceived))  # a drawn one stays
            if _exists_by_assertion_alone(record, asserted, rest):
                return self._writer().change(MapUpdate(removed=(record.iri,)), cause)
            change = self._restate(record, rest, cause)
            change = noted(change, self._facts.base, self._facts.catalogue)
            for former in asserted.keys() - rest.keys():
                self._forget_name(asserted[former], by)
            return change

    def with_assertions(
        self, target: Mapping[str, PropertyAssertions]
    ) -> tuple[tuple[Quad, ...], tuple[Quad, ...], tuple[str, ...]]:
        """Quads to delete and to insert so that each subject has exactly the given assertions.

        `target` has the assertions by IRI. Perception's present estimates are kept. The third value
        has the IRIs that are not in the map and so cannot have assertions.
        """
        deleted: list[Quad] = []
        kept: list[tuple[ObjectRecord | PlaceRecord, PropertyAssertions]] = []
        with self._guard:  # the writer's cache belongs to one thread at a time
            records: list[ObjectRecord | PlaceRecord] = [*self._perceived.objects(tuple(target))]
            records += (place for place in self._perceived.places() if place.iri in target)
            for record in records:
                asserted = target[record.iri]
                if _exists_by_assertion_alone(record, self._of(record.iri), asserted):
                    deleted += self._writer().all_quads_of(record.iri)
                else:
                    kept.append((self._placed(record, asserted), asserted))
            stored, wanted = self._writer().restatement(kept)
        missing = target.keys() - {record.iri for record, _ in kept}
        gone = {quad.subject.value for quad in deleted if isinstance(quad.subject, NamedNode)}
        return (*deleted, *stored), wanted, tuple(sorted(missing - gone))

    def full(self, iri: str, kind: str = "iri") -> str:
        """IRI of a thing by its id (object/17), IRI or label, as `SemanticMap.resolve` reads it.

        Raises InvalidFactError for a text that names none.
        """
        try:
            return NamedNode(self._resolve(kind, iri)).value
        except (ValueError, QueryParameterError) as error:
            why = (
                f"{error}" if isinstance(error, QueryParameterError) else f"no thing {iri[:200]!r}"
            )
            raise InvalidFactError(f"{why}; its IRI, or as in object/17, place/1, works") from error

    def place(self, name: str) -> str:
        """IRI of a place by its id, label or number; "" for none."""
        try:
            return self._resolve("place", name)
        except QueryParameterError:
            return ""

    def made(
        self,
        record: ObjectRecord | PlaceRecord,
        asserted: PropertyAssertions,
        prop: str,
        text: str,
        by: str,
    ) -> Assertion:
        """The new assertion, with what perception believes where the writer does not know it."""
        before = self._label(record, asserted) if prop == "label" else None
        if isinstance(record, PlaceRecord) and prop == "area":
            earlier = asserted.get("area")
            before = earlier.perceived if earlier else area_text(record.area)
        made = Assertion(record.iri, prop, text, by.strip(), time.time(), before)
        if prop in asserted and asserted[prop].value == text:
            made = replace(made, since=asserted[prop].since)
        return made

    def _is_pair(self, one: Assertion, other: Assertion) -> bool:
        """Whether two assertions are the category and the label of one name."""
        if (one.by, one.stamp) != (other.by, other.stamp):
            return False
        pair = {one.property: one.value, other.property: other.value}
        if pair.keys() != {"category", "label"}:
            return False
        named = category_of_name(self._facts.catalogue, pair["label"])
        return named is not None and named.iri == pair["category"]

    def _position_checked(self, record: ObjectRecord | PlaceRecord, prop: str, text: str) -> str:
        """A line about odd numbers; raises InvalidFactError for impossible ones."""
        points: list[Sequence[float]] = []
        if prop == "position":
            points = [point(text).tolist()]
        elif prop == "area":
            points = [corner for ring in area_of_polygon(text).rings for corner in ring]
        thing = record.iri.removeprefix(self._facts.base)
        if prop == "extent":
            return check_sides(self._store.engine, [(thing, point(text)[:3])])
        what = f"{prop} of {thing}"
        return check_positions(self._store.engine, points, what) if points else ""

    def _check_not_replaced(self, present: Assertion, by: str) -> None:
        """Raise InvalidFactError where `present` replaced an assertion that `by` made."""
        for event in self._own_events(present, by):
            if event.cause.kind == "assert":
                base = self._facts.base
                raise InvalidFactError(
                    f"the {present.property} of {present.subject.removeprefix(base)} is by "
                    f"{present.by} now ({shown_value(present, self._facts.catalogue)}), asserted "
                    f"{ago(present.stamp)} ago, after that of {by}; it stays: an assertion of "
                    "one's own would replace it"
                )
            return

    def _own_events(self, present: Assertion, by: str) -> Iterator[HistoryEvent]:
        """The assertions and retractions by `by` of a property of a thing, the latest first."""
        # a name is a label as well
        stated = ("label", "category") if present.property == "label" else (present.property,)
        about = tuple(f"{present.subject} {prop} " for prop in stated)
        try:
            events = [*self._history.events(present.subject)]
        except HereaboutsError:  # a map without a history, or a thing older than it
            return
        for event in reversed(events):
            if event.cause.by == by and f"{event.cause.note} ".startswith(about):
                yield event

    def _forget_name(self, former: Assertion | None, by: str | None) -> None:
        """Remove the category of an assertion that no longer holds, if a person's name made it."""
        if former is not None and former.property == "category":
            self._names().forget_name(former.value, by)

    def _restate(
        self, record: ObjectRecord | PlaceRecord, asserted: PropertyAssertions, cause: Cause
    ) -> ChangeSet | None:
        return self._writer().restate(self._placed(record, asserted), asserted, cause)

    def _placed(
        self, record: ObjectRecord | PlaceRecord, asserted: PropertyAssertions
    ) -> ObjectRecord | PlaceRecord:
        """The record; an object gets the place that contains its asserted position."""
        if isinstance(record, PlaceRecord):
            return record
        x, y = (float(value) for value in believed_object(record, asserted).p_map[:2])
        places = self._facts.places(self._store.engine)
        inside = (place.iri for place in places if place.area.contains(x, y))
        return replace(record, place=next(inside, None))

    def _record(self, iri: str) -> ObjectRecord | PlaceRecord:
        for record in self._perceived.objects((iri,)):
            return record
        for place in self._perceived.places():
            if place.iri == iri:
                return place
        raise InvalidFactError(
            f"no object or place {iri} in this map; give its IRI, or as in object/17, place/1"
        )

    def _related_object(self, iri: str, prop: str, given: object) -> str:
        """IRI of the object of an asserted relation (on, inside), or "nothing"."""
        text = str(given).strip()
        if text == NOTHING:
            return NOTHING
        other = self.full(text)
        if other == iri or not self._perceived.objects((other,)):
            raise InvalidFactError(
                f"{iri} cannot be {prop} {text!r}; another object of this map would work, as in "
                f"object/17, or {NOTHING}"
            )
        return other

    def _label(
        self, record: ObjectRecord | PlaceRecord, asserted: PropertyAssertions
    ) -> str | None:
        if "label" in asserted:
            return asserted["label"].perceived
        if isinstance(record, PlaceRecord):
            return record.label
        label = self._facts.label(self._store.engine, record.iri)
        given = self._facts.object_label(believed_object(record, asserted))
        return None if label == given else label

    def _of(self, iri: str) -> dict[str, Assertion]:
        return self._assertions.of(self._store.engine, iri)


def _exists_by_assertion_alone(
    record: ObjectRecord | PlaceRecord, before: PropertyAssertions, after: PropertyAssertions
) -> bool:
    """Whether only an assertion that is missing in `after` keeps an object in the map."""
    retracted = "existence" in before and "existence" not in after
    return retracted and isinstance(record, ObjectRecord) and record.existence <= 0
