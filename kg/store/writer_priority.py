"""Writer priority: readers of a process wait while its writer writes a frame.

Threads of one process share the interpreter's lock. A thread that decodes an answer releases the
lock only every few milliseconds, so two such readers could delay a writer beyond the next frame.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

from kg.store.write_limit import check_time

Item = TypeVar("Item")

MAX_WAIT: Final = 0.05  # [s] of one call, in case the writer waits for a lock of the reader

_writers: dict[int, threading.Event] = {}  # by thread; the interpreter's lock guards it


@contextmanager
def writing() -> Iterator[None]:
    """For the length of a block, the readers of this process wait."""
    me = threading.get_ident()
    if me in _writers:
        yield
        return
    done = _writers[me] = threading.Event()
    try:
        yield
    finally:
        del _writers[me]
        done.set()


def yield_to_writer() -> None:
    """Wait for the end of the current frame; the writer's own thread does not wait.

    Readers call it between pieces of work. Later frames do not prolong the wait, so a reader
    completes one piece a frame beside a writer that never pauses.
    """
    if _writers and threading.get_ident() not in _writers:
        # `copy` is atomic; a garbage collection may let a writer run between other steps
        for done in _writers.copy().values():
            done.wait(MAX_WAIT)


def in_pieces(items: Iterable[Item], size: int) -> Iterator[Item]:
    """The items; yields to the writer before each piece of `size` items."""
    for number, item in enumerate(items):
        if not number % size:
            check_time()
            yield_to_writer()
        yield item
