"""Sizes of many categories tell a wrong unit of depth, and never a usual room."""

from __future__ import annotations

import pytest

from mapping.objects.existence import unusual_scale, usual_sizes

#: as the bundled detectors measured a real kitchen, in usual sizes
KITCHEN = {
    "chair": 0.52, "tv": 0.54, "bottle": 0.88, "cup": 0.9, "sink": 1.02, "book": 1.23,
    "dining table": 1.31,
}  # fmt: skip


def things(factor: float) -> list[tuple[str, float]]:
    return [(label, factor * r * usual_sizes()[label].longest) for label, r in KITCHEN.items()]


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_a_usual_room_is_told_nothing(factor):
    assert unusual_scale(things(factor)) is None


@pytest.mark.parametrize("factor", [0.1, 0.2, 5.0, 10.0])
def test_a_wrong_unit_is_told_with_its_factor(factor):
    found = unusual_scale(things(factor))
    assert found is not None
    assert found == pytest.approx(factor, rel=0.3)


def test_few_categories_tell_nothing():
    assert unusual_scale(things(10.0)[:3]) is None
    assert unusual_scale([("chair", 9.0)] * 20) is None
    assert unusual_scale([("chair", 0.0), ("unheard of", 50.0)]) is None


def test_one_large_category_does_not_decide():
    assert unusual_scale([*things(1.0), ("cup", 4.0), ("cup", 4.0), ("cup", 4.0)]) is None
