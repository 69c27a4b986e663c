"""File locks, memory, and other calls of the operating system that only some systems have.

Everything here works on Linux. Elsewhere a lock is exclusive where Linux shares it, and what cannot
be asked for is left out: a map is then read by one process at a time.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Final

fcntl: Any
resource: Any  # None where a system has no limits of processes
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None
try:
    import resource
except ImportError:
    resource = None

#: of `os.open`: no link is followed, and a pipe does not block
NO_LINK: Final = getattr(os, "O_NOFOLLOW", 0)
NO_WAIT: Final = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
_FOLDER: Final = getattr(os, "O_DIRECTORY", None)


def lock(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open file until it is closed; raises BlockingIOError while another has it locked."""
    if fcntl is not None:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        return
    try:
        import msvcrt
    except ImportError:
        return  # no locks at all: RocksDB still refuses a second writer
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except OSError as error:
        raise BlockingIOError(str(error)) from error


def open_folder(folder: Path) -> int | None:
    """A descriptor of a folder, to sync or to lock it; None where a system opens no folders."""
    if _FOLDER is None:
        return None
    return os.open(folder, os.O_RDONLY | _FOLDER | NO_WAIT)


def user() -> int | None:
    """The number of the user of this process; None where users have none."""
    return os.geteuid() if hasattr(os, "geteuid") else None


def open_files() -> int:
    """Files and sockets that this process may open."""
    if resource is None:
        return 512
    soft: int = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return sys.maxsize if soft == resource.RLIM_INFINITY else soft


def most_memory() -> float:
    """The most memory that this process has had [MB]; 0 where it cannot be known."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        if resource is None:
            return 0.0
        return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1e6  # bytes on macOS
    return int(status.partition("VmHWM:")[2].split()[0]) / 1000


def end_within(seconds: float) -> None:
    """Let the kernel end this process in `seconds`, unless an earlier call was made; else nothing.

    Does nothing where the kernel has no timers of processes.
    """
    timer = getattr(signal, "ITIMER_REAL", None)
    if timer is not None and not signal.getitimer(timer)[0]:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(timer, seconds)


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
    import ctypes

    trim: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim
