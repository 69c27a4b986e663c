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

from kg.serving.workers.isolation.file_access import restrict_files
from kg.serving.workers.isolation.system_calls import check_result, filter_system_calls

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
