"""Garbage collection of a program that writes a map live."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_frozen() -> Iterator[None]:
    """For the length of a block, exempt the objects that exist now from garbage collection.

    A full collection visits every object and takes 100 to 300 ms, several frames, most of it for
    libraries and ontologies that stay anyway. Programs enter the block once the map is open.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
