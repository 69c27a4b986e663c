"""Network isolation of a process by the kernel: a seccomp-BPF filter, or a network namespace.

A process that evaluates untrusted text calls `deny_network` before it reads any. From then on the
kernel refuses it every new socket (`seccomp(2)`, inherited by its children, irrevocable, available
without privileges since Linux 3.17), or, where filters are not available, leaves it in a network
namespace of its own without interfaces (`unshare(2)`). The standard library alone is used, since
workers start often.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import socket
import struct
from dataclasses import dataclass
from typing import Final, Literal

Mechanism = Literal["seccomp", "namespace", "none"]


@dataclass(frozen=True, slots=True)
class _Abi:
    """System call numbers of one architecture (``asm/unistd.h``, ``linux/audit.h``)."""

    audit: int
    seccomp: int
    refused: tuple[int, ...]  # socket, ptrace, process_vm_writev, io_uring_setup, pidfd_getfd


_ABIS: Final = {
    "x86_64": _Abi(0xC000003E, 317, (41, 101, 311, 425, 438)),
    "aarch64": _Abi(0xC00000B7, 277, (198, 117, 271, 425, 438)),
}
_PR_SET_NO_NEW_PRIVS: Final = 38
_SET_MODE_FILTER: Final = 1
_ALL_THREADS: Final = 1  # SECCOMP_FILTER_FLAG_TSYNC
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
_ALLOW, _KILL, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
_LOAD, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06  # BPF opcodes
_X32: Final = 0x40000000  # the bit of x86_64's second system call table


class _Program(ctypes.Structure):
    """``struct sock_fprog``."""

    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def deny_network() -> Mechanism:
    """Deny this process the network permanently, and verify it; "none" if the kernel cannot.

    Must be called while the process has one thread. File descriptors that were open before remain:
    the caller starts the process with its pipes alone.
    """
    if platform.system() != "Linux":
        return "none"
    mechanisms = {"seccomp": _filter_system_calls, "namespace": _unshare_network}
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


def _filter_system_calls() -> None:
    """Install the filter in all threads; raises OSError if the kernel has no filters."""
    abi = _ABIS.get(platform.machine())
    if abi is None or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise OSError(errno.ENOSYS, "no system call table for this machine")
    libc = ctypes.CDLL(None, use_errno=True)
    _checked(libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
    code = _bpf(abi)
    program = _Program(len(code) // 8, code)
    _checked(libc.syscall(abi.seccomp, _SET_MODE_FILTER, _ALL_THREADS, ctypes.byref(program)))


def _bpf(abi: _Abi) -> bytes:
    """The filter program: kills other architectures, fails refused calls with EACCES."""
    refusals = len(abi.refused)
    steps = [
        (_LOAD, 0, 0, 4),  # seccomp_data.arch
        (_EQUAL, 1, 0, abi.audit),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, 0),  # seccomp_data.nr
        (_AT_LEAST, refusals + 1, 0, _X32),
        *((_EQUAL, refusals - at, 0, number) for at, number in enumerate(abi.refused)),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _ERRNO | errno.EACCES),
    ]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)


def _unshare_network() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    _checked(libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET))


def _checked(result: int) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
