"""Calls by which a program writes files, recorded by strace and repeated on a `Disk`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.kills.disk import Disk, File, Folder

_CALLS: Final = (
    "openat,write,pwrite64,writev,pwritev,ftruncate,fallocate,rename,renameat,renameat2,unlink,"
    "unlinkat,rmdir,mkdir,mkdirat,link,linkat,fsync,fdatasync,lseek,sendfile,copy_file_range"
)
_LINE: Final = re.compile(rb"(\d+) +(?:<\.\.\. \w+ resumed>)?(.*?)( <unfinished \.\.\.>)?$")
_CALL: Final = re.compile(rb"(\w+)\((.*)\) += (-?\d+)(?:<([^>]*)>)?")
_STRING: Final = re.compile(rb'"((?:\\x[0-9a-f]{2})*)"')
_BASE: Final = re.compile(rb"^(?:AT_FDCWD|\d+)<([^>]*)>$")


@dataclass(frozen=True, slots=True)
class Call:
    """One call: its name, arguments as strace writes them, and result.

    `begins` is true for the beginning of a sync; its end is a call of its own.
    """

    thread: bytes
    name: str
    arguments: tuple[bytes, ...]
    result: int
    path: str  # of the file that it opened or concerns, or ""
    data: bytes = b""  # that it writes
    begins: bool = False


def available() -> bool:
    """Whether this machine has strace."""
    return shutil.which("strace") is not None


def recorded(words: Iterable[str], trace: Path) -> list[Call]:
    """The calls of ``python WORDS``, in order. Raises RuntimeError where the program fails."""
    command = ["strace", "-f", "-y", "-xx", "-s", str(1 << 28), "-e", f"trace={_CALLS}"]
    command += ["-o", str(trace), sys.executable, *words]
    run = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
    if run.returncode:
        raise RuntimeError(f"the recorded program failed: {run.stderr}")
    return [*_calls(trace.read_bytes().splitlines())]


def told(call: Call) -> bytes:
    """Bytes that the program wrote to stdout by this call."""
    return call.data if call.arguments[0].startswith(b"1<") else b""


class Repetition:
    """Repeats calls on a disk; `changes` says of a call whether it concerned the disk."""

    def __init__(self, disk: Disk) -> None:
        self._disk = disk
        self._open: dict[bytes, tuple[File | Folder, int, bool]] = {}
        self._syncing: dict[bytes, tuple[int, int]] = {}

    def changes(self, call: Call) -> bool:
        """Repeat a call; whether it changed something, or synced it."""
        if call.result < 0:
            return False
        if call.name == "openat":
            return self._opened(call)
        if call.name in ("rename", "renameat", "renameat2", "link", "linkat"):
            return self._named(call)
        if call.name in ("mkdir", "mkdirat", "rmdir", "unlink", "unlinkat"):
            return self._made(call)
        return self._written(call)

    def _opened(self, call: Call) -> bool:
        flags, descriptor = call.arguments[2], b"%d" % call.result
        self._open.pop(descriptor, None)
        if not self._disk.holds(call.path):
            return False
        before = self._disk.at(call.path)
        if before is None and b"O_CREAT" not in flags:
            return False
        node = self._disk.create(call.path) if before is None else before
        if isinstance(node, File) and b"O_TRUNC" in flags and node.size:
            self._disk.truncate(node, 0)
        self._open[descriptor] = node, 0, b"O_APPEND" in flags
        return before is None or b"O_TRUNC" in flags

    def _named(self, call: Call) -> bool:
        old, new = _paths(call.arguments)
        if not self._disk.holds(old) or not self._disk.holds(new):
            return False
        change: Callable[[str, str], None] = (
            self._disk.link if call.name.startswith("link") else self._disk.rename
        )
        change(old, new)
        return True

    def _made(self, call: Call) -> bool:
        (path,) = _paths(call.arguments)
        if not self._disk.holds(path):
            return False
        (self._disk.make_folder if call.name.startswith("mkdir") else self._disk.remove)(path)
        return True

    def _written(self, call: Call) -> bool:
        descriptor = call.arguments[0].partition(b"<")[0]
        if descriptor not in self._open or not self._disk.holds(call.path):
            return False
        node, position, append = self._open[descriptor]
        if call.name in ("fsync", "fdatasync"):
            return self._synced(call, node)
        if isinstance(node, Folder):
            return False
        if call.name == "lseek":
            self._open[descriptor] = node, call.result, append
            return False
        if call.name == "ftruncate":
            self._disk.truncate(node, int(call.arguments[1]))
            return True
        if call.name == "fallocate":
            size = sum(map(int, call.arguments[2:]))
            if call.arguments[1] == b"0" and size > node.size:
                self._disk.truncate(node, size)
            return True
        if call.name not in ("write", "writev", "pwrite64", "pwritev"):
            raise NotImplementedError(f"{call.name} into a recorded file")
        data = call.data[: call.result]
        if call.name.startswith("p"):
            node.write(int(call.arguments[-1]), data)
            return True
        start = node.size if append else position
        node.write(start, data)
        self._open[descriptor] = node, start + len(data), append
        return True

    def _synced(self, call: Call, node: File | Folder) -> bool:
        if call.begins:
            writes = len(node.unsynced) if isinstance(node, File) else 0
            self._syncing[call.thread] = writes, self._disk.entries
            return False
        self._disk.sync(node, *self._syncing.pop(call.thread))
        return True


def _calls(lines: Iterable[bytes]) -> Iterator[Call]:
    begun: dict[bytes, bytes] = {}
    for line in lines:
        if (match := _LINE.match(line)) is None:
            continue
        thread, text, unfinished = match.groups()
        if unfinished:
            begun[thread] = text
            yield from _beginning(thread, text)
            continue
        whole = begun.pop(thread, None)
        if whole is None:
            yield from _beginning(thread, text)
        if call := _CALL.match((whole or b"") + text):
            yield _call(thread, *call.groups())


def _call(thread: bytes, name: bytes, given: bytes, result: bytes, opened: bytes | None) -> Call:
    arguments, data = (*given.split(b", "),), b""
    if b"write" in name:
        data = _text(given)
        arguments = arguments[0], arguments[-1]  # the descriptor, and the offset if there is one
    path = opened or arguments[0].rstrip(b">").partition(b"<")[2]
    return Call(thread, name.decode(), arguments, int(result), _path(path), data)


def _beginning(thread: bytes, text: bytes) -> Iterator[Call]:
    for name in (b"fsync", b"fdatasync"):
        if text.startswith(name + b"("):
            argument = text[len(name) + 1 :].partition(b")")[0]
            path = _path(argument.rstrip(b">").partition(b"<")[2])
            yield Call(thread, name.decode(), (argument,), 0, path, begins=True)


def _paths(arguments: Iterable[bytes]) -> list[str]:
    """The paths among arguments, each relative to the folder that stands before it."""
    found, folder = [], ""
    for argument in arguments:
        if match := _BASE.match(argument):
            folder = _path(match[1])
        elif _STRING.fullmatch(argument):
            found.append(str(Path(folder, os.fsdecode(_text(argument)))))
    return found


def _text(argument: bytes) -> bytes:
    return b"".join(map(_bytes, _STRING.findall(argument)))


def _bytes(escaped: bytes) -> bytes:
    return bytes.fromhex(escaped.replace(b"\\x", b"").decode())


def _path(escaped: bytes) -> str:
    return os.fsdecode(_bytes(escaped)) if escaped.startswith(b"\\x") else ""
