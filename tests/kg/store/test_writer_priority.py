"""Readers of a process wait for its writer, and neither waits for ever."""

import gc
import threading
from collections.abc import Callable

import numpy as np
import pytest

from kg.model.records import MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import in_memory_map
from kg.store import scheduling as writer_priority
from kg.store.scheduling import in_pieces, writing, yield_to_writer

LONG = 600.0  # [s] what no test lasts


def _beside(act: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    return thread


def _ended(thread: threading.Thread) -> bool:
    thread.join(120)
    return not thread.is_alive()


def _held(thread: threading.Thread) -> bool:
    thread.join(0.1)
    return thread.is_alive()


def test_a_reader_waits_until_the_frame_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_priority, "MAX_WAIT", LONG)
    with writing():
        reader = _beside(yield_to_writer)
        assert _held(reader)
    assert _ended(reader)


def test_a_reader_passes_where_nothing_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_priority, "MAX_WAIT", LONG)
    with pytest.raises(KeyError), writing():
        raise KeyError
    assert _ended(_beside(yield_to_writer))


def test_who_writes_reads_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_priority, "MAX_WAIT", LONG)

    def write() -> None:
        with writing():
            with writing():
                yield_to_writer()
            yield_to_writer()

    assert _ended(_beside(write))


def test_a_writer_that_waits_for_its_reader_is_waited_for_but_a_moment() -> None:
    with writing():
        assert _ended(_beside(yield_to_writer))


@pytest.mark.parametrize(
    "read", [lambda found: found.query("robot"), lambda found: found.objects()]
)
def test_questions_and_records_yield_to_the_writer(read, monkeypatch):
    monkeypatch.setattr(writer_priority, "MAX_WAIT", LONG)
    seen: list[bool] = []
    with in_memory_map() as found:
        found.query("robot")  # read from its file once
        room = PlaceRecord(found.place_iri(1), "room", 0.0, 1.0, 0.0, 1.0, views=0, beliefs={})
        found.apply(MapUpdate(places=(room,)))

        def amid_a_frame(_: object) -> None:
            read(found)  # the writer's own: standing queries are asked so
            readers.append(_beside(lambda: read(found)))
            seen.append(_held(readers[0]))

        readers: list[threading.Thread] = []
        found.store.listen(amid_a_frame)
        found.apply(MapUpdate(robot=RobotRecord(np.zeros(3), 0.0, 1e9)))
        assert seen == [True]
        assert _ended(readers[0])


def test_reading_in_pieces_yields_before_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_priority, "MAX_WAIT", LONG)
    read: list[int] = []
    with writing():
        reader = _beside(lambda: read.extend(in_pieces(range(7), 3)))
        assert _held(reader)
        assert read == []
    assert _ended(reader)
    assert read == [*range(7)]


def test_a_writer_that_ends_amid_a_collection_harms_no_reader(monkeypatch):
    # a collection calls back into Python, where another thread may take over: here it always does,
    # and a writer begins or ends each time
    done = threading.Event()
    done.set()
    # more than tuples are kept in store for, so that another one is one more thing to collect
    under_way = {-number: done for number in range(1, 31)}
    monkeypatch.setattr(writer_priority, "_writers", under_way)

    def meanwhile(phase: str, _: object) -> None:
        if phase == "start" and under_way.pop(0, None) is None:
            under_way[0] = done

    before = gc.get_threshold()
    gc.callbacks.append(meanwhile)
    try:
        gc.set_threshold(1)
        for _ in range(100):
            yield_to_writer()
    finally:
        gc.set_threshold(*before)
        gc.callbacks.remove(meanwhile)
