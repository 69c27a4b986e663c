"""Memory that is free again goes back to the system.

The C library keeps freed memory in pieces between what is still used. A map that is written for
hours allocates and frees some megabytes a second, and its process slowly grows though what it holds
does not: by a third over an hour at 30 frames a second.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from typing import Final

EVERY: Final = 60.0  # [s] between two times of giving back, of a map that is written


def give_back() -> bool:
    """Hand free pages to the system; whether there were any. Nothing happens without glibc.

    Takes some milliseconds, without the interpreter's lock.
    """
    trim = _trim()
    return trim is not None and trim(0) == 1


@cache
def _trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    trim: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim
