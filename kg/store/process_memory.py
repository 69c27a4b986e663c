"""Memory of a process that writes a map live: garbage collection and heap trimming."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Final

TRIM_EVERY: Final = 60.0  # [s] for a map that is written


@contextmanager
def gc_frozen() -> Iterator[None]:
    """For the length of a block, exempt the objects that exist now from garbage collection.

    A full collection visits every object and takes 100 to 300 ms, the time of several frames. Most
    objects belong to libraries and ontologies and stay anyway. Enter the block with the map open.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def trim_heap() -> bool:
    """Return free pages of the C library to the system; True if there were any.

    Without trimming, a process that writes a map at 30 frames a second grows by a third in an
    hour. Takes some milliseconds, without the interpreter's lock. Does nothing without glibc.
    """
    trim = _trim()
    return trim is not None and trim(0) == 1


@cache
def _trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    trim: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim
