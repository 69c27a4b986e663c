"""Confinement of a process by the kernel: system calls, files, network, privileges.

A process that evaluates untrusted text calls `confine` before it reads any. A filter allows a list
of system calls, and Landlock shuts all files but the snapshots. Where filters are not available, a
network namespace without interfaces (`unshare(2)`) keeps the process from the network. The standard
library alone is used, since workers start often.

The filter is a seccomp-BPF program that allows a list of calls. Calls that are
not on the list fail with EACCES. Calls that are newer than the list fail with ENOSYS, so that the C
library falls back on an older one. The filter is inherited by all threads and cannot be removed
(`seccomp(2)`; without privileges since Linux 3.17).
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import socket
import struct
import sys
import sysconfig
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

#: name, number on x86_64, number on aarch64 (`asm/unistd_64.h`, `asm-generic/unistd.h`)
_CALLS: Final = """
brk 12 214, munmap 11 215, mremap 25 216, madvise 28 233, membarrier 324 283, msync 26 227,
mincore 27 232,
read 0 63, write 1 64, readv 19 65, writev 20 66, pread64 17 67, pwrite64 18 68, preadv 295 69,
pwritev 296 70, open 2 -, openat 257 56, close 3 57, close_range 436 436, lseek 8 62, stat 4 -,
lstat 6 -, fstat 5 80, newfstatat 262 79, statx 332 291, access 21 -, faccessat 269 48,
faccessat2 439 439, readlink 89 -, readlinkat 267 78, getdents 78 -, getdents64 217 61,
getcwd 79 17, flock 73 32, fsync 74 82, fdatasync 75 83, sync_file_range 277 84, fallocate 285 47,
ftruncate 77 46, truncate 76 45, fadvise64 221 223, readahead 187 213, statfs 137 43,
fstatfs 138 44, mkdir 83 -, mkdirat 258 34, rmdir 84 -, unlink 87 -, unlinkat 263 35, rename 82 -,
renameat 264 38, renameat2 316 276, link 86 -, linkat 265 37, umask 95 166, dup 32 23,
exit 60 93, exit_group 231 94, getpid 39 172, gettid 186 178, getppid 110 173, getuid 102 174,
geteuid 107 175, getgid 104 176, getegid 108 177, uname 63 160, sysinfo 99 179, sched_yield 24 124,
sched_getaffinity 204 123, getcpu 309 168, getrusage 98 165, times 100 153, getrlimit 97 163,
setrlimit 160 164, futex 202 98, set_robust_list 273 99, set_tid_address 218 96, rseq 334 293,
restart_syscall 219 128, rt_sigaction 13 134, rt_sigprocmask 14 135, rt_sigreturn 15 139,
sigaltstack 131 132, setitimer 38 103, clock_gettime 228 113, clock_getres 229 114,
clock_nanosleep 230 115, nanosleep 35 101, gettimeofday 96 169, time 201 -, getrandom 318 278,
poll 7 -, ppoll 271 73, select 23 -, pselect6 270 72
"""
#: beside them, for a worker that may use the network
_NETWORK_CALLS: Final = """
socket 41 198, connect 42 203, bind 49 200, getsockname 51 204, getpeername 52 205,
getsockopt 55 209, setsockopt 54 208, shutdown 48 210, sendto 44 206, sendmsg 46 211,
sendmmsg 307 269, recvfrom 45 207, recvmsg 47 212, recvmmsg 299 243
"""
#: calls allowed only with one of some values of one argument
_CALLS_WITH: Final = """
clone 56 220, fcntl 72 25, ioctl 16 29, prctl 157 167, prlimit64 302 261, tgkill 234 131
"""
#: calls refused with one bit of one argument
_CALLS_WITHOUT: Final = "mmap 9 222, mprotect 10 226"
_CLONE3: Final = 435  # its flags are in memory, where a filter cannot read them
_NEWER: Final = 463  # the first number that the list does not know; also x86_64's second table

_AUDIT: Final = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}  # `linux/audit.h`
_SECCOMP: Final = {"x86_64": 317, "aarch64": 277}
_SET_MODE_FILTER, _ALL_THREADS = 1, 1  # SECCOMP_FILTER_FLAG_TSYNC
_PROT_EXEC: Final = 4
_NEW_THREAD: Final = 0x3D0F00  # flags of `pthread_create`; with musl CLONE_DETACHED too
#: F_DUPFD to F_SETLKW, F_OFD_*, F_DUPFD_CLOEXEC, write hints; not F_SETOWN, which sends signals
_FCNTL: Final = (*range(8), 36, 37, 38, 1030, 1035, 1036, 1037, 1038)
_IOCTL: Final = (0x5401, 0x5451)  # TCGETS (isatty), FIOCLEX
_PRCTL: Final = (15, 0x53564D41)  # PR_SET_NAME, PR_SET_VMA
_ALLOW, _KILL, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # BPF opcodes

Step = tuple[int, int, int, int]


class _Program(ctypes.Structure):
    """``struct sock_fprog``."""

    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def filter_system_calls(*, network: bool = False) -> None:
    """Install the filter in all threads of this process; `network` allows sockets.

    Raises OSError if the kernel has no filters, or the machine is neither x86_64 nor aarch64.
    """
    machine = platform.machine()
    if machine not in _AUDIT or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise OSError(errno.ENOSYS, "no system call table for this machine")
    libc = ctypes.CDLL(None, use_errno=True)
    check_result(libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
    code = _program(machine, network)
    program = _Program(len(code) // 8, code)
    number = _SECCOMP[machine]
    check_result(libc.syscall(number, _SET_MODE_FILTER, _ALL_THREADS, ctypes.byref(program)))


def check_result(result: int) -> None:
    """Raise OSError, with the C library's `errno`, for a failed call."""
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def numbers(calls: str, machine: str) -> dict[str, int]:
    """Numbers of the calls of a table on a machine."""
    column = list(_AUDIT).index(machine) + 1
    rows = (row.split() for row in calls.split(","))
    return {row[0]: int(row[column]) for row in rows if row[column] != "-"}


def _program(machine: str, network: bool) -> bytes:
    steps: list[Step] = [
        (_LOAD, 0, 0, 4),  # seccomp_data.arch
        (_EQUAL, 1, 0, _AUDIT[machine]),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, 0),  # seccomp_data.nr
    ]
    for number in numbers(_CALLS + ("," + _NETWORK_CALLS if network else ""), machine).values():
        steps += [(_EQUAL, 0, 1, number), (_RETURN, 0, 0, _ALLOW)]
    steps += _conditions(machine)
    steps += [
        (_EQUAL, 1, 0, _CLONE3),
        (_AT_LEAST, 0, 1, _NEWER),
        (_RETURN, 0, 0, _ERRNO | errno.ENOSYS),
        (_RETURN, 0, 0, _ERRNO | errno.EACCES),
    ]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)


def _conditions(machine: str) -> list[Step]:
    """Calls that depend on the lower half of one argument; all others pass to the next step."""
    call = numbers(_CALLS_WITH, machine)
    values: dict[str, tuple[int, tuple[int, ...]]] = {  # position of the argument, its values
        "clone": (0, (_NEW_THREAD, _NEW_THREAD | 0x400000)),
        "fcntl": (1, _FCNTL),
        "ioctl": (1, _IOCTL),
        "prctl": (0, _PRCTL),
        "prlimit64": (0, (0,)),
        "tgkill": (0, (os.getpid(),)),  # `abort` sends itself a signal
    }
    steps: list[Step] = []
    for name, (position, allowed) in values.items():
        tests = [s for v in allowed for s in ((_EQUAL, 0, 1, v), (_RETURN, 0, 0, _ALLOW))]
        steps += _for_call(call[name], position, [*tests, (_RETURN, 0, 0, _ERRNO | errno.EACCES)])
    for number in numbers(_CALLS_WITHOUT, machine).values():
        refused = (_RETURN, 0, 0, _ERRNO | errno.EACCES)
        steps += _for_call(
            number, 2, [(_ANY_BIT, 0, 1, _PROT_EXEC), refused, (_RETURN, 0, 0, _ALLOW)]
        )
    return steps


def _for_call(number: int, position: int, tests: list[Step]) -> list[Step]:
    argument = 16 + 8 * position  # seccomp_data.args, little endian
    return [(_EQUAL, 0, len(tests) + 1, number), (_LOAD, 0, 0, argument), *tests]


_CREATE, _ADD, _RESTRICT = 444, 445, 446  # system calls, the same on all machines
_VERSION: Final = 1  # LANDLOCK_CREATE_RULESET_VERSION
_BENEATH: Final = 1  # LANDLOCK_RULE_PATH_BENEATH
_PR_SET_NO_NEW_PRIVS: Final = 38
READ: Final = 0b1100  # READ_FILE, READ_DIR
#: READ, WRITE_FILE, REMOVE_DIR, REMOVE_FILE, MAKE_DIR, MAKE_REG, TRUNCATE
WRITE: Final = READ | 1 << 1 | 1 << 4 | 1 << 5 | 1 << 7 | 1 << 8 | 1 << 14
#: number of rights on files that a version of the interface knows
_RIGHTS: Final = {1: 13, 2: 14, 3: 15, 4: 15}
_RIGHTS_NOW: Final = 16  # since version 5
_OF_FILES: Final = 1 << 1 | 1 << 2 | 1 << 14  # rights that a file, no folder, can have
_TCP: Final = 0b11  # bind and connect, since version 4
_SCOPES: Final = 0b11  # abstract UNIX sockets and signals, since version 6


class _Ruleset(ctypes.Structure):
    """``struct landlock_ruleset_attr``."""

    _fields_ = (
        ("files", ctypes.c_uint64),
        ("network", ctypes.c_uint64),
        ("scoped", ctypes.c_uint64),
    )


class _Beneath(ctypes.Structure):
    """``struct landlock_path_beneath_attr``."""

    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


def restrict_files(
    readable: Iterable[Path], writable: Iterable[Path] = (), *, network: bool = False
) -> None:
    """Shut this thread, and those it starts, off from all files outside of some files and folders.

    Paths that do not exist are skipped. Raises OSError where the kernel has no Landlock.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(_CREATE, None, 0, _VERSION)
    check_result(version)
    handled = (1 << _RIGHTS.get(version, _RIGHTS_NOW)) - 1
    rules = _Ruleset(
        handled,
        _TCP if version >= 4 and not network else 0,
        _SCOPES if version >= 6 else 0,
    )
    ruleset = libc.syscall(_CREATE, ctypes.byref(rules), ctypes.sizeof(rules), 0)
    check_result(ruleset)
    try:
        for paths, rights in ((readable, READ), (writable, WRITE)):
            for path in paths:
                _allow(libc, ruleset, path, rights & handled)
        check_result(libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
        check_result(libc.syscall(_RESTRICT, ruleset, 0))
    finally:
        os.close(ruleset)


def _allow(libc: ctypes.CDLL, ruleset: int, path: Path, rights: int) -> None:
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
        try:
            if not path.is_dir():
                rights &= _OF_FILES
            rule = _Beneath(rights, opened)
            check_result(libc.syscall(_ADD, ruleset, _BENEATH, ctypes.byref(rule), 0))
        finally:
            os.close(opened)


Mechanism = Literal["seccomp", "namespace", "allowed", "none"]

_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
_PR_SET_DUMPABLE: Final = 4
_CAPABILITY_VERSION: Final = 0x20080522
#: CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH: root may serve the map of another user
_KEPT_CAPABILITIES: Final = 0b110
#: sources of random numbers, and the number of processors
_SYSTEM_FILES: Final = ("/dev/urandom", "/sys/devices/system/cpu/online")
#: certificates and names of hosts, for a worker with a network
_NETWORK_FILES: Final = (
    *("/etc/ssl", "/etc/pki", "/etc/ca-certificates", "/usr/share/ca-certificates"),
    *("/usr/local/share/ca-certificates", "/etc/resolv.conf", "/etc/hosts", "/etc/nsswitch.conf"),
    *("/etc/host.conf", "/etc/gai.conf", "/run/systemd/resolve", "/etc/services"),
)


@dataclass(frozen=True, slots=True)
class Confinement:
    """Confinement of a process by the kernel."""

    network: Mechanism = "none"  # the mechanism that denies the network
    files: bool = False  # whether files outside of the snapshots are shut

    @property
    def denies_network(self) -> bool:
        """Whether the process reaches no network."""
        return self.network in ("seccomp", "namespace")

    def warnings(self) -> list[str]:
        """A line for each thing that the kernel of this machine cannot do."""
        lines = []
        if not self.denies_network:
            lines.append(
                "the kernel of this machine cannot keep queries from the network: queries that "
                "contain the letters SERVICE or LOAD are refused"
            )
        if self.network != "seccomp":
            lines.append(
                "the kernel of this machine cannot limit the system calls of query workers"
            )
        if not self.files:
            lines.append(
                "the kernel of this machine has no Landlock: a query worker can open the files of "
                "this account"
            )
        return lines


def confine(
    readable: Iterable[Path] = (), writable: Iterable[Path] = (), *, network: bool = False
) -> Confinement:
    """Confine this process permanently to some folders, without `network` also from the network.

    Must be called while the process has one thread and all its extension modules are loaded. File
    descriptors that were open before remain: the caller starts the process with its pipes alone.
    """
    if platform.system() != "Linux":
        return Confinement()
    _drop_capabilities()
    files = False
    with contextlib.suppress(OSError, AttributeError):
        more = map(Path, (*_SYSTEM_FILES, *(_NETWORK_FILES if network else ())))
        restrict_files((*_program_files(), *readable, *more), writable, network=network)
        files = True
    if not network:
        return Confinement(deny_network(), files)
    with contextlib.suppress(OSError, AttributeError):
        filter_system_calls(network=True)
    return Confinement("allowed", files)


def deny_network() -> Mechanism:
    """Deny this process the network permanently, and verify it; "none" if the kernel cannot."""
    mechanisms = {"seccomp": filter_system_calls, "namespace": unshare_network}
    for name, deny in mechanisms.items():
        with contextlib.suppress(OSError, AttributeError):
            deny()
            if is_denied():
                return name  # type: ignore[return-value]
    return "none"


def is_denied() -> bool:
    """Whether the kernel denies this process the loopback, and so any, network.

    Sends nothing: a UDP socket is connected at most, which only looks up a route.
    """
    for family, address in ((socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")):
        try:
            with socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((address, 9))
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.ENETUNREACH, errno.EAFNOSUPPORT,
                                   errno.EADDRNOTAVAIL):  # fmt: skip
                return False
        else:
            return False
    return True


def unshare_network() -> None:
    """Leave the network namespace for one without interfaces; raises OSError if refused."""
    libc = ctypes.CDLL(None, use_errno=True)
    check_result(libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET))


def hide_memory() -> None:
    """Make this process not dumpable: others of its account cannot read its memory (`prctl(2)`)."""
    if platform.system() == "Linux":
        ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)


def _drop_capabilities() -> None:
    """Drop the privileges of root, except those to read files of other users."""
    if os.geteuid() != 0:
        return
    head = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    kept = (ctypes.c_uint32 * 6)(_KEPT_CAPABILITIES, _KEPT_CAPABILITIES, 0, 0, 0, 0)
    ctypes.CDLL(None).capset(head, kept)


def _program_files() -> list[Path]:
    """Python's library and the loaded packages, since some modules are imported late."""
    packages = (sys.modules[name].__file__ for name in ("kg", "numpy", "pyoxigraph"))
    return [
        Path(sysconfig.get_path("stdlib")),
        *(Path(file).parent for file in packages if file is not None),
    ]
