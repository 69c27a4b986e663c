"""Right of way: readers of a process wait while its writer writes a frame.

Threads of one process share the interpreter's lock, and a thread that decodes an answer hands it
over only every few milliseconds: a writer that meets two such readers several times a frame comes
too late for the next one. What is short and due has right of way over what can wait.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

Item = TypeVar("Item")

MOST: Final = 0.05  # [s] waited at one place, in case the writer waits for what the reader holds

_under_way: dict[int, threading.Event] = {}  # by thread; one interpreter's lock, one dictionary


@contextmanager
def writing() -> Iterator[None]:
    """For the length of a block, have right of way over the readers of this process."""
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


def give_way() -> None:
    """Wait until what is being written at this moment is written; a writer itself passes.

    Called between pieces of reading. It waits for no frame that is begun meanwhile: beside a writer
    that never rests a reader gets on by a piece a frame.
    """
    if _under_way and threading.get_ident() not in _under_way:
        # a copy made in one step: a collection may let a writer in between any others
        for done in _under_way.copy().values():
            done.wait(MOST)


def in_pieces(items: Iterable[Item], most: int) -> Iterator[Item]:
    """The items, giving way before each piece of `most` of them."""
    for number, item in enumerate(items):
        if not number % most:
            give_way()
        yield item
