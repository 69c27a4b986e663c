"""The same pattern has the same answer at every door."""

import pytest

from tests.doors.doors import READING, House

BANANA, CUP, BED = "object/1", "object/2", "object/3"
#: patterns by what they ask, and the things that match
PATTERNS = {
    "a class": ("?thing a here:Cup", {CUP}),
    "a number": ("?thing here:x ?x FILTER(?x < 2)", {BANANA}),
    "a relation of classes": ("?thing a ?c . ?c here:locatedAt here:Bedroom", {BED}),
}


@pytest.mark.parametrize("door", READING)
@pytest.mark.parametrize("asked", PATTERNS)
def test_a_pattern_has_one_answer(house: House, door: str, asked: str) -> None:
    pattern, expected = PATTERNS[asked]
    found = READING[door](house, pattern)
    assert {thing.removeprefix(house.map.base) for thing in found} == expected
