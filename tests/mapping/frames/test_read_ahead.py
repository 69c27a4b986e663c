"""Items that a thread makes ahead of their use."""

import threading

import pytest

from mapping.frames.read_ahead import read_ahead


def readers() -> int:
    return sum(thread.name == "read-ahead" for thread in threading.enumerate())


def test_no_more_than_so_many_are_made_before_they_are_asked_for():
    made, third = [], threading.Event()

    def items():
        for n in range(9):
            made.append(n)
            if n == 2:
                third.set()
            yield n

    ahead = read_ahead(items(), count=2)
    assert next(ahead) == 0
    assert third.wait(10)
    ahead.close()
    # one was used, two wait, and one is in hand
    assert made[-1] <= 3


def test_an_error_comes_after_the_items_before_it():
    def items():
        yield 1
        yield 2
        raise ValueError("the third is broken")

    ahead = read_ahead(items())
    assert [next(ahead), next(ahead)] == [1, 2]
    with pytest.raises(ValueError, match="the third is broken"):
        next(ahead)
    assert readers() == 0


def test_closing_ends_the_thread_and_closes_the_source():
    closed = []

    def items():
        try:
            yield from range(1000)
        finally:
            closed.append(threading.current_thread().name)

    with pytest.raises(KeyboardInterrupt):
        for n in read_ahead(items()):
            if n == 3:
                raise KeyboardInterrupt
    assert readers() == 0
    assert closed == ["read-ahead"]


def test_chained_stages_run_side_by_side():
    """Each stage waits for the other to work on another item, so that one thread would hang."""
    met = threading.Barrier(2, timeout=20)

    def first():
        for n in range(4):
            if n > 0:
                met.wait()
            yield n

    def second(items):
        for n in items:
            if n < 3:
                met.wait()
            yield n

    assert list(read_ahead(second(read_ahead(first())))) == [0, 1, 2, 3]
