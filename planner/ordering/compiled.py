"""Functions of numpy arrays compiled to machine code (numba), and whether they are at hand.

Compiling takes half a minute once, on a first use; what comes of it is kept on disk, next to the
package or, where that is not writable, in the user's cache folder. Loading it takes a second. Both
are too long for a limit of one second, so `solve` never does either: who wants orders made with
compiled steps calls `warm_up` first. Without numba, or without that call, numpy does the work.
"""

from __future__ import annotations

import importlib
import importlib.util
import time
from collections.abc import Callable
from types import ModuleType
from typing import Any, Final, TypeVar, cast

_Function = TypeVar("_Function", bound=Callable[..., Any])
#: the module that solves with compiled steps, once it is loaded
_loaded: dict[str, ModuleType] = {}
_MODULE: Final = "planner.ordering.fast"


def compiled(signature: str) -> Callable[[_Function], _Function]:
    """Decorator: compile for the argument types of `signature`, in numba's notation, now."""
    import numba

    def compile_now(function: _Function) -> _Function:
        return cast(_Function, numba.njit(signature, cache=True)(function))

    return compile_now


def available() -> bool:
    """Whether numba is installed."""
    return importlib.util.find_spec("numba") is not None


def warm_up() -> float | None:
    """Load what is compiled, compiling it where it is not: the seconds it took; None without numba.

    From then on `solve` makes use of it.
    """
    if not available():
        return None
    begin = time.perf_counter()
    if _MODULE not in _loaded:
        _loaded[_MODULE] = importlib.import_module(_MODULE)
    return time.perf_counter() - begin


def fast() -> ModuleType | None:
    """What `warm_up` has loaded; None before."""
    return _loaded.get(_MODULE)


def cool_down() -> None:
    """Undo `warm_up`: `solve` is left to numpy again."""
    _loaded.clear()
