"""Read ahead: the items of an iterator are made in a thread while the caller uses earlier ones."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterator
from queue import SimpleQueue
from typing import Final, TypeVar

T = TypeVar("T")

AHEAD: Final = 2  # items made in advance


def read_ahead(items: Iterator[T], count: int = AHEAD) -> Generator[T]:
    """The items in their order, at most `count` of them made in advance.

    An exception of the iterator is raised in place of its next item. One thread alone uses the
    iterator; it has ended once the generator is closed or exhausted. Stages chained this way run
    side by side: `read_ahead(detect(read_ahead(read())))`.
    """
    made: SimpleQueue[tuple[T] | BaseException | None] = SimpleQueue()
    room, ended = threading.Semaphore(count), threading.Event()

    def make() -> None:
        try:
            for item in items:
                room.acquire()
                if ended.is_set():
                    return
                made.put((item,))
            made.put(None)
        except BaseException as error:  # noqa: BLE001 - raised again by the caller's thread
            made.put(error)
        finally:
            if isinstance(items, Generator):
                items.close()

    thread = threading.Thread(target=make, name="read-ahead", daemon=True)
    thread.start()
    try:
        while (item := made.get()) is not None:
            if isinstance(item, BaseException):
                raise item
            room.release()
            yield item[0]
    finally:
        ended.set()
        room.release()
        thread.join()
