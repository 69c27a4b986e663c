"""Confinement of a process by the kernel: system calls, files, network, privileges.

A process that evaluates untrusted text calls `confine` before it reads any. A filter allows a list
of system calls (`system_calls`), and Landlock shuts all files but the snapshots
(`file_access`). Where filters are not available, a network namespace without
interfaces (`unshare(2)`) keeps the process from the network. The standard library alone is used,
since workers start often.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import socket
import sys
import sysconfig
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from kg.serving.workers.isolation.system_calls import check_result, filter_system_calls

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
