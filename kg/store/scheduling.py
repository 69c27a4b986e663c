"""Scheduling of writers: limits of a write, priority over readers, and flushing every few seconds.

A server puts a `WriteLimit` in force for each request that writes. Loops over a client's facts call
`check_time`, the lock of the map and `TransactionalStore.commit` do the rest. Without a limit, as
on the command line and in Python, nobody else waits, and nothing is checked.

Threads of one process share the interpreter's lock. A thread that decodes an answer releases the
lock only every few milliseconds, so two such readers could delay a writer beyond the next frame.
"""

from __future__ import annotations

import contextlib
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self, TypeVar

from kg.model.errors import GraphError, InvalidFactError, PoolBusyError, QueryTimeoutError
from kg.model.platforms import TRIM_EVERY, trim_heap

if TYPE_CHECKING:
    from kg.store.transactional import TransactionalStore


HELD: Final = 2.0  # [s] of processor time that a limited write may hold the lock of the map
#: Facts that one limited transaction may add and remove: history and engine write them in one go,
#: which takes about 1.5 s on one core of a small computer, and others wait meanwhile.
MAX_FACTS: Final = 60_000
_SECONDS_OF_A_FACT: Final = 1.5 / MAX_FACTS


@dataclass(slots=True)
class WriteLimit:
    """Limit of one write; `ending` is set when the server ends."""

    seconds: float  # of processor time; also [s] to wait for the lock
    ending: threading.Event = field(default_factory=threading.Event)
    _until: float = 0.0  # processor time of the thread
    _held_since: float | None = None  # the same, while the thread holds the lock

    @contextmanager
    def in_force(self) -> Iterator[None]:
        """Limit the writes of this thread for the length of a block."""
        self._until = time.thread_time() + self.seconds
        before, _thread.limit = _current(), self
        try:
            yield
        finally:
            _thread.limit = before

    def check(self, more: float = 0.0) -> None:
        """Raise an error if the time is over, or will be in `more` seconds, or the server ends."""
        if self.ending.is_set():
            raise PoolBusyError("the server ends; nothing was written")
        if time.thread_time() > self._until:
            raise QueryTimeoutError(
                f"the write takes more than {self.seconds:g} s, and nothing was written; "
                "several smaller ones would work"
            )
        if self._held_since is not None and time.thread_time() - self._held_since + more > HELD:
            raise QueryTimeoutError(
                f"the write makes others wait for more than {HELD:g} s, and nothing was written; "
                "several smaller ones would work"
            )


_thread = threading.local()


def _current() -> WriteLimit | None:
    return getattr(_thread, "limit", None)


def check_time() -> None:
    """Raise an error if this thread's write has reached its limit.

    Raises QueryTimeoutError, or PoolBusyError if the server ends.
    """
    limit = _current()
    if limit is not None:
        limit.check()


def check_facts(count: int) -> None:
    """Raise an error if this thread's write is limited and changes too many facts.

    Raises InvalidFactError, or as `check_time` if too little of the time is left for them.
    """
    limit = _current()
    if limit is None:
        return
    if count > MAX_FACTS:
        raise InvalidFactError(
            f"this would change {count:,} facts at once, and nothing was written; at most "
            f"{MAX_FACTS:,} in one request would work"
        )
    limit.check(_SECONDS_OF_A_FACT * count)


class WriterLock:
    """The lock of a map's writer, re-entrant; a limited write waits for it no longer than it may.

    Raises PoolBusyError if others hold it for so long.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._depth = 0  # guarded by the lock itself

    def __enter__(self) -> Self:
        limit = _current()
        if not self._lock.acquire(timeout=-1 if limit is None else limit.seconds):
            raise PoolBusyError("others write to this map; try again later")
        self._depth += 1
        if limit is not None and self._depth == 1:
            limit._held_since = time.thread_time()
        return self

    def __exit__(self, *exception: object) -> None:
        limit = _current()
        self._depth -= 1
        if limit is not None and self._depth == 0:
            limit._held_since = None
        self._lock.release()


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


FLUSH_EVERY = 3.0  # [s]


def keep_flushing(store: TransactionalStore) -> Callable[[], None]:
    """Flush a store every few seconds, in a thread; returns a function that ends the thread.

    The thread also ends when nobody holds the store any more. It returns free memory to the system
    while the store is written.
    """
    # a weak reference, so that an unreferenced store is freed although never closed
    reference, stop = weakref.ref(store), threading.Event()
    thread = threading.Thread(target=_flush_until, args=(reference, stop), daemon=True)
    thread.start()

    def end() -> None:
        stop.set()
        thread.join()

    return end


def _flush_until(reference: weakref.ref[TransactionalStore], stop: threading.Event) -> None:
    trimmed, written = time.monotonic(), 0
    while not stop.wait(FLUSH_EVERY):
        store = reference()
        if store is None:
            return
        with contextlib.suppress(GraphError):  # the next commit, or closing, reports it
            store.flush()
        sequence = store.sequence
        del store
        if sequence != written and time.monotonic() - trimmed > TRIM_EVERY:
            trim_heap()
            trimmed, written = time.monotonic(), sequence
