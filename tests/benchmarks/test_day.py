"""`python -m benchmarks.day` goes on straight from the rows of a shorter run."""

import pytest

from benchmarks.day import DAY, HOUR, Row, whole_day


def test_the_row_of_a_day_follows_from_the_first_and_the_last() -> None:
    first = Row(0.5, HOUR // 2, 50.0, 40.0, 500.0, 5.0, 2.0, 30.0, 60, 100, 100)
    last = Row(1.0, HOUR, 50.0, 40.0, 510.0, 5.0, 4.0, 31.0, 60, 110, 150)
    row = whole_day([first, last])
    assert (row.hours, row.frames) == (24.0, DAY)
    assert (row.ms, row.cpu, row.objects) == (50.0, 40.0, 60)
    assert (row.memory, row.history) == (510 + 46 * 10, pytest.approx(4 + 46 * 2))
    assert (row.iris, row.issued) == (110 + 46 * 10, 150 + 46 * 50)


def test_history_that_was_compacted_grows_as_before() -> None:
    rows = [
        Row(n / 2, n * HOUR // 2, 50.0, 40.0, 500.0, 5.0, history, 30.0, 60, 100, 100)
        for n, history in ((1, 2.0), (2, 4.0), (3, 1.0))
    ]
    assert whole_day(rows).history == pytest.approx(1 + 45 * 2)
