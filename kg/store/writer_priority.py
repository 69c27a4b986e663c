"""Writer priority: readers of a process wait while its writer writes a frame.

Threads of one process share the interpreter's lock, and a thread that decodes an answer releases it
only every few milliseconds. A writer that waits for two such readers several times a frame would be
late for the next frame.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

Item = TypeVar("Item")

MAX_WAIT: Final = 0.05  # [s] at one place, in case the writer waits for a lock of the reader

_under_way: dict[int, threading.Event] = {}  # by thread; the interpreter's lock guards it


@contextmanager
def writing() -> Iterator[None]:
    """For the length of a block, have the readers of this process wait."""
    me = threading.get_ident()
    if me in _under_way:
        yield
        return
    done = _under_way[me] = threading.Event()
    try:
        yield
    finally:
        del _under_way[me]
        done.set()


def yield_to_writer() -> None:
    """Wait until the frame that is being written is written; the writer itself does not wait.

    Called between pieces of reading. It does not wait for frames that begin meanwhile, so beside a
    writer that never pauses a reader reads one piece a frame.
    """
    if _under_way and threading.get_ident() not in _under_way:
        # `copy` is one step; a garbage collection may let a writer in between any others
        for done in _under_way.copy().values():
            done.wait(MAX_WAIT)


def in_pieces(items: Iterable[Item], size: int) -> Iterator[Item]:
    """The items, yielding to the writer before each piece of `size` of them."""
    for number, item in enumerate(items):
        if not number % size:
            yield_to_writer()
        yield item
