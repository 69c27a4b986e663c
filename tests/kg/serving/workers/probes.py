"""Acts of an attacker who executes code in a worker: each raises OSError where it is refused.

`main` is a worker as the pool starts it, confined as ever; only its evaluator runs acts by name.
"""

# the acts are single system calls, as an attacker makes them
# ruff: noqa: PTH101, PTH104, PTH108, PTH111, PTH123, PTH208, PTH211, T201

import ctypes
import fcntl
import json
import mmap
import os
import platform
import resource
import signal
import socket
import sys
from collections.abc import Callable
from typing import Any

from kg.serving.workers.evaluation import evaluator

LIBC = ctypes.CDLL(None, use_errno=True)
ARM = platform.machine() == "aarch64"
PARENT = os.getppid()
RWX = mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC


def call(name: str, *arguments: object) -> int:
    """A function of the C library; raises OSError with its errno."""
    return checked(getattr(LIBC, name)(*arguments))


def system_call(x86_64: int, aarch64: int, *arguments: object) -> int:
    return checked(LIBC.syscall(aarch64 if ARM else x86_64, *arguments))


def checked(result: int) -> int:
    if result == -1:
        raise OSError(ctypes.get_errno(), "refused")
    return result


def read(path: str) -> None:
    with open(path, "rb") as file:
        file.read(1)


def write(path: str) -> None:
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600))


def fork() -> None:
    if os.fork() == 0:
        os._exit(0)


def clone() -> None:
    if system_call(56, 220, signal.SIGCHLD, None, None, None, None) == 0:
        os._exit(0)


def connect() -> None:
    with socket.socket() as made:
        made.connect(("127.0.0.1", 9))


def executable_memory() -> None:
    mmap.mmap(-1, 4096, prot=RWX)


def made_executable() -> None:
    memory = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    call("mprotect", ctypes.c_void_p(start), 4096, RWX)


def readv() -> None:
    place = (ctypes.c_size_t * 2)(ctypes.addressof(ctypes.create_string_buffer(8)), 8)
    system_call(310, 270, PARENT, place, 1, place, 1, 0)


def signals_by_fcntl() -> None:
    fcntl.fcntl(0, 8, PARENT)  # F_SETOWN


#: given: the folder of the snapshot
ACTS: dict[str, Callable[[str], object]] = {
    "read a file of the system": lambda _: read("/etc/passwd"),
    "list the root": lambda _: os.listdir("/"),
    "list the home": lambda _: os.listdir(os.path.expanduser("~")),
    "read the parent's environment": lambda _: read(f"/proc/{PARENT}/environ"),
    "read the parent's memory": lambda _: read(f"/proc/{PARENT}/mem"),
    "read the parent's maps": lambda _: read(f"/proc/{PARENT}/maps"),
    "list the parent's files": lambda _: os.listdir(f"/proc/{PARENT}/fd"),
    "read memory by a call": lambda _: readv(),
    "write memory by a call": lambda _: system_call(311, 271, PARENT, None, 0, None, 0, 0),
    "take a descriptor": lambda _: system_call(434, 434, PARENT, 0),
    "trace the parent": lambda _: call("ptrace", 16, PARENT, None, None),
    "kill the parent": lambda _: os.kill(PARENT, 0),
    "kill by thread": lambda _: system_call(234, 131, PARENT, PARENT, 0),
    "kill a group": lambda _: os.killpg(os.getpgid(0), 0),
    "send signals by a file": lambda _: signals_by_fcntl(),
    "connect": lambda _: connect(),
    "a pair of sockets": lambda _: socket.socketpair(),
    "a netlink socket": lambda _: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0),
    "execute a program": lambda _: os.execv("/bin/true", ["true"]),
    "fork": lambda _: fork(),
    "fork by clone": lambda _: clone(),
    "fork by clone3": lambda _: system_call(435, 435, (ctypes.c_uint64 * 8)(), 64),
    "executable memory": lambda _: executable_memory(),
    "memory made executable": lambda _: made_executable(),
    "a file in memory": lambda _: os.memfd_create("x"),
    "execute a descriptor": lambda _: system_call(322, 281, 0, b"", None, None, 0x1000),
    "io_uring": lambda _: system_call(425, 425, 1, (ctypes.c_uint8 * 120)()),
    "bpf": lambda _: system_call(321, 280, 0, (ctypes.c_uint8 * 64)(), 64),
    "userfaultfd": lambda _: system_call(323, 282, 1),
    "performance events": lambda _: system_call(298, 241, (ctypes.c_uint8 * 64)(), 0, -1, -1, 0),
    "keys of the kernel": lambda _: system_call(250, 219, 0, -3, 0, 0, 0),
    "a namespace": lambda _: call("unshare", 0x10000000),
    "another root": lambda _: os.chroot("/"),
    "mount": lambda _: call("mount", b"none", b"/tmp", b"tmpfs", 0, None),
    "another user": lambda _: os.setuid(0),
    "capabilities": lambda _: system_call(126, 91, (ctypes.c_uint32 * 2)(0x20080522, 0), None),
    "limits of the parent": lambda _: resource.prlimit(PARENT, resource.RLIMIT_NOFILE),
    "priority of the parent": lambda _: os.setpriority(os.PRIO_PROCESS, PARENT, 5),
    "another personality": lambda _: call("personality", 0x0400000),
    "a second system call table": lambda _: checked(LIBC.syscall(0x40000000 + 39)),
    "write into the snapshot": lambda snapshot: write(f"{snapshot}/CURRENT"),
    "a file in the snapshot": lambda snapshot: write(f"{snapshot}/new"),
    "remove a file of the snapshot": lambda snapshot: os.unlink(f"{snapshot}/CURRENT"),
    "rename a file of the snapshot": lambda s: os.rename(f"{s}/CURRENT", f"{s}/OTHER"),
    "shorten a file of the snapshot": lambda snapshot: os.truncate(f"{snapshot}/CURRENT", 0),
    "rights of the snapshot": lambda snapshot: os.chmod(snapshot, 0o777),
    "a symbolic link": lambda snapshot: os.symlink("/etc/passwd", f"{snapshot}/../scratch/link"),
    "a hard link to write": lambda s: os.link(f"{s}/CURRENT", f"{s}/../scratch/link"),
    "a device": lambda snapshot: os.mknod(f"{snapshot}/../scratch/device", 0o20600, 0x103),
    "a pipe in a folder": lambda snapshot: os.mkfifo(f"{snapshot}/../scratch/pipe"),
    "a file in /tmp": lambda _: write("/tmp/hereabouts-probe"),
    "a device of the system": lambda _: read("/dev/zero"),
    "input for a terminal": lambda _: fcntl.ioctl(0, 0x5412, b"x"),
}

#: acts that need neither privileges nor a kernel's option where nothing confines a process
PLAIN = (
    *("read a file of the system", "list the root", "kill the parent", "kill a group"),
    *("a pair of sockets", "a netlink socket", "fork", "fork by clone", "executable memory"),
    *("memory made executable", "a file in memory", "list the parent's files"),
    *("read the parent's environment", "read the parent's maps", "a device of the system"),
    *("limits of the parent", "send signals by a file", "write into the snapshot"),
    *("a symbolic link", "rights of the snapshot", "a file in the snapshot"),
)


def has_landlock() -> bool:
    """Whether the kernel answers with the version of Landlock that it has."""
    try:
        return system_call(444, 444, None, 0, 1) > 0
    except OSError:
        return False


def attempt(name: str, snapshot: str) -> str:
    """ "done", or the name of the error."""
    try:
        ACTS[name](snapshot)
    except OSError as error:
        return type(error).__name__ + f" {error.errno}"
    return "done"


class Prober(evaluator.Evaluator):
    """An evaluator that an attacker has taken over."""

    def answer(self, kind: bytes, request: dict[str, Any]) -> None:
        found = {name: attempt(name, request["folder"]) for name in ACTS}
        self._send_all("", json.dumps(found).encode(), request | {"max_bytes": 1 << 20})


def main() -> None:
    evaluator.Evaluator = Prober  # type: ignore[misc]
    evaluator.main()


if __name__ == "__main__":  # unconfined
    print(json.dumps({name: attempt(name, sys.argv[1]) for name in PLAIN}))
