"""People say how things are, and take it back."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

from kg.assertions import (
    PROPERTIES,
    Assertions,
    Said,
    believed_object,
    perceived_object,
    perceived_place,
    value_of,
)
from kg.commits import Cause, ChangeSet
from kg.errors import InvalidFactError, did_you_mean
from kg.facts import Facts
from kg.records import Assertion, MapUpdate, ObjectRecord, PlaceRecord
from kg.store import MapStore
from kg.writer import Writer


class Sayings:
    """Asserts and retracts in one map; each is one transaction."""

    def __init__(self, store: MapStore, facts: Facts, writer: Writer) -> None:
        self._store, self._facts, self._writer = store, facts, writer
        self._assertions = Assertions(facts.base)

    def said(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """What was said, of one thing or of all."""
        if iri is None:
            return self._assertions.all(self._store.engine)
        return tuple(self._of(self.full(iri)).values())

    def objects(self, iris: tuple[str, ...] | None) -> tuple[ObjectRecord, ...]:
        """Objects as perception believes them; all where `iris` is None."""
        engine, facts = self._store.engine, self._facts
        found = facts.objects(engine) if iris is None else facts.some_objects(engine, iris)
        said = self._by_subject()
        return tuple(perceived_object(record, said.get(record.iri, {})) for record in found)

    def places(self) -> tuple[PlaceRecord, ...]:
        """Places as perception believes them."""
        said = self._by_subject()
        found = self._facts.places(self._store.engine)
        return tuple(perceived_place(record, said.get(record.iri, {})) for record in found)

    def assert_(self, iri: str, prop: str, given: object, by: str) -> ChangeSet | None:
        """Have `prop` of a thing be as given, whatever perception believes."""
        if not by.strip():
            raise InvalidFactError("an assertion needs somebody who makes it: by='ann'")
        record = self._record(self.full(iri))
        kind = "object" if isinstance(record, ObjectRecord) else "place"
        value = value_of(prop, given, self._facts.catalogue, kind)
        said = self._of(record.iri)
        label = self._label(record, said) if prop == "label" else None
        made = Assertion(record.iri, prop, value, by.strip(), time.time(), label)
        if prop in said and said[prop].value == value:
            made = replace(made, since=said[prop].since)
        cause = Cause("assert", by, f"{record.iri} {prop} {value}")
        return self._restate(record, {**said, prop: made}, cause)

    def retract(self, iri: str, prop: str, by: str | None) -> ChangeSet | None:
        """Take back what was said of `prop`: what perception believes is believed again."""
        record = self._record(self.full(iri))
        said = self._of(record.iri)
        if prop not in said:
            hint = "" if prop in PROPERTIES else did_you_mean(prop, PROPERTIES)
            raise InvalidFactError(
                f"nothing was said of the {prop} of {iri}; "
                f"said of it: {', '.join(sorted(said)) or 'nothing'}{hint}"
            )
        cause = Cause("retract", by, f"{record.iri} {prop}")
        if prop == "existence" and isinstance(record, ObjectRecord) and record.existence <= 0:
            update = MapUpdate(removed=(record.iri,))  # perception gave it up meanwhile
            return self._writer.change(update, cause)
        rest = {name: assertion for name, assertion in said.items() if name != prop}
        return self._restate(record, rest, cause)

    def full(self, iri: str) -> str:
        """``object/17`` as the IRI it is short for; a full IRI as it is."""
        return iri if ":" in iri else self._facts.base + iri

    def _restate(
        self, record: ObjectRecord | PlaceRecord, said: Said, cause: Cause
    ) -> ChangeSet | None:
        if isinstance(record, ObjectRecord):
            x, y, _ = believed_object(record, said).p_map
            record = replace(record, place=self._place_at(float(x), float(y)) or None)
        return self._writer.restate(record, said, cause)

    def _place_at(self, x: float, y: float) -> str | None:
        for place in self._facts.places(self._store.engine):
            if place.xmin <= x <= place.xmax and place.ymin <= y <= place.ymax:
                return place.iri
        return None

    def _record(self, iri: str) -> ObjectRecord | PlaceRecord:
        for record in self.objects((iri,)):
            return record
        for place in self.places():
            if place.iri == iri:
                return place
        raise InvalidFactError(
            f"no object or place {iri} in this map; give its IRI, or as in object/17, place/1"
        )

    def _label(self, record: ObjectRecord | PlaceRecord, said: Said) -> str | None:
        if "label" in said:
            return said["label"].perceived
        if isinstance(record, PlaceRecord):
            return record.label
        label = self._facts.label(self._store.engine, record.iri)
        given = self._facts.object_label(believed_object(record, said))
        return None if label == given else label

    def _of(self, iri: str) -> dict[str, Assertion]:
        return self._assertions.of(self._store.engine, iri)

    def _by_subject(self) -> Mapping[str, dict[str, Assertion]]:
        said: dict[str, dict[str, Assertion]] = {}
        for assertion in self._assertions.all(self._store.engine):
            said.setdefault(assertion.subject, {})[assertion.property] = assertion
        return said
