"""`python -m benchmarks.growth` compares the cost of each column with its work."""

import pytest

from benchmarks import growth
from benchmarks.growth import COLUMNS, Row, growths


def test_a_column_that_grows_faster_than_its_work_is_named() -> None:
    small = dict.fromkeys(COLUMNS, 1.0)
    rows = [
        Row(100, 0, small),
        Row(1000, 0, {**small, "query": 10.0, "apply": 3.0, "find": 20.0}),
        Row(50, 10, small),
        Row(50, 100, {**small, "disk": 9.0, "opening": 2.0}),
    ]
    fast = {(one.column, one.of) for one in growths(rows) if one.too_fast}
    assert fast == {("apply", "objects"), ("find", "objects"), ("opening", "frames")}


def test_the_table_has_a_number_in_every_column() -> None:
    row = growth.row(40, 3)
    assert (row.objects, row.frames) == (40, 3)
    assert row.costs.keys() == COLUMNS.keys()
    assert min(row.costs.values()) > 0


def test_a_map_is_no_option_without_its_numbers() -> None:
    with pytest.raises(SystemExit):
        growth.main(["--measure", "somewhere"])
