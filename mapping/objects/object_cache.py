"""Object cache: a map's objects as perception believes them, and the assertions about them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.assertions import PropertyAssertions, believed_object
from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import PerceivedObjects
from kg.model.records import ObjectRecord


class ObjectCache:
    """Cache of a map's objects, with changes that are not written yet."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self.perceived = PerceivedObjects(semantic_map)  # by IRI
        self._assertions: dict[str, PropertyAssertions] = {}
        self._changed: set[str] = set()
        self._read_assertions(self.perceived)

    def believed(self, record: ObjectRecord) -> ObjectRecord:
        """Record with assertions applied."""
        asserted = self._assertions.get(record.iri)
        return record if asserted is None else believed_object(record, asserted)

    def objects(self) -> tuple[ObjectRecord, ...]:
        """All objects, with assertions applied."""
        return tuple(self.believed(record) for record in self.perceived.values())

    def get(self, iri: str) -> ObjectRecord | None:
        """Object with that IRI, with assertions applied; None where there is none."""
        record = self.perceived.get(iri)
        return None if record is None else self.believed(record)

    def candidates(self) -> Iterator[ObjectRecord]:
        """Objects as detections may show them: as perceived, and as asserted where that differs."""
        for record in self.perceived.values():
            yield record
            if record.iri in self._assertions:
                believed = self.believed(record)
                yield believed
                yield replace(record, category=believed.category)
                yield replace(record, p_map=believed.p_map)

    def asserted_present(self, iri: str | None) -> bool:
        """Whether the object's existence is asserted."""
        return self._asserted_existence(iri) == "present"

    def asserted_absent(self, iri: str | None) -> bool:
        """Whether it is asserted that the object is not there."""
        return self._asserted_existence(iri) == "absent"

    def _asserted_existence(self, iri: str | None) -> str | None:
        existence = self._assertions.get(iri or "", {}).get("existence")
        return None if existence is None else existence.value

    def asserted(self, iri: str | None) -> tuple[NDArray[np.float64] | None, str | None]:
        """Position (3,) [m] and category of an object as people assert them.

        None where they do not, or as perceived.
        """
        record = None if iri is None else self.perceived.get(iri)
        if record is None:
            return None, None
        believed = self.believed(record)
        if believed is record:
            return None, None
        moved = not np.allclose(believed.p_map, record.p_map)
        return believed.p_map if moved else None, believed.category

    def has_assertions(self, iri: str | None) -> bool:
        """Whether anything is asserted of the object."""
        return iri is not None and iri in self._assertions

    def update(self, records: Mapping[str, ObjectRecord]) -> None:
        """Store new records by IRI."""
        self.perceived |= records
        self._changed |= records.keys()

    def remove(self, iris: Iterable[str]) -> None:
        """Forget objects."""
        for iri in iris:
            del self.perceived[iri]
            self._changed.add(iri)
            self._assertions.pop(iri, None)

    def take_changed(self) -> frozenset[str]:
        """IRIs of things that anybody changed since the last call."""
        changed, self._changed = frozenset(self._changed), set()
        return changed

    def invalidate(self, iris: Iterable[str]) -> None:
        """Mark objects to be read again at the next `refresh`."""
        self.perceived.invalidate(iris)

    def refresh(self) -> frozenset[str]:
        """IRIs of things that others changed since the last call, read again; cheap where none."""
        touched = self.perceived.refresh()
        self._changed |= touched
        if not touched:
            return touched
        for iri in touched - self.perceived.keys():
            self._assertions.pop(iri, None)
        self._read_assertions(touched & self.perceived.keys())
        return touched

    def _read_assertions(self, iris: Iterable[str]) -> None:
        by_subject: dict[str, PropertyAssertions] = {}
        for assertion in self._map.assertions.all():
            by_subject[assertion.subject] = {
                **by_subject.get(assertion.subject, {}),
                assertion.property: assertion,
            }
        for iri in iris:
            self._assertions.pop(iri, None)
            if iri in by_subject:
                self._assertions[iri] = by_subject[iri]
