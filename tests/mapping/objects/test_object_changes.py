"""Changes of several frames as one."""

from __future__ import annotations

import numpy as np

from kg.model.records import DepartedRecord, ObjectRecord
from mapping.objects.object_mapper import ObjectChanges


def _record(iri: str, existence: float) -> ObjectRecord:
    return ObjectRecord(
        iri=iri,
        category="cup",
        p_map=np.zeros(3),
        confidence=3 * existence,
        existence=existence,
        observations=1,
        first_seen=0.0,
        last_seen=0.0,
    )


def _departed(iri: str) -> DepartedRecord:
    return DepartedRecord(iri, "cup", np.zeros(3), 0.9, 1, 0.0, 0.0, 1.0)


def test_of_each_object_the_end_counts() -> None:
    first = ObjectChanges(
        (_record("a", 0.5), _record("b", 0.5)), ("c", "d"), departed=(_departed("c"),)
    )
    then = ObjectChanges((_record("a", 0.7), _record("c", 0.6)), ("b",), departed=(_departed("b"),))
    both = first.followed_by(then)
    assert {record.iri: record.existence for record in both.updated} == {"a": 0.7, "c": 0.6}
    assert both.removed == ("b", "d")
    assert [record.iri for record in both.departed] == ["b"]
