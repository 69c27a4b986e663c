"""Keep Python's own housekeeping out of the way of a live map."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def settled() -> Iterator[None]:
    """For the length of a block, spare what was loaded before it from garbage collection.

    A full collection goes through every object there is: 60 to 200 ms, which is several frames, for
    libraries and ontologies that stay anyway. For programs that write a map live, once it is open.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
