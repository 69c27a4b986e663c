"""A disk whose power is cut: which of the writes to a folder are there afterwards.

The model is a journaling file system (ext4, XFS) at its worst. Data that were not synced are lost,
kept, or kept in part, in any order. Names and cut lengths (metadata) are kept in their order, up to
some point. Sync of a file or folder keeps the metadata up to the last change of that file or
folder; sync of a file that has grown keeps all metadata, since its new blocks are metadata too.
`Disk` is told of calls and makes the folder that a cut at that moment would leave.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

SECTOR = 512  # [bytes] that a disk writes whole or not at all
Names = dict[str, "File | Folder | None"]


@dataclass(slots=True)
class Write:
    """Bytes at an offset, or (`data` None) a new length, which is metadata."""

    offset: int
    data: bytes | None
    kept: bool = False  # of a new length: whether the journal has it


@dataclass(slots=True)
class File:
    """A file: its bytes on the disk, and the writes since."""

    synced: bytearray = field(default_factory=bytearray)
    unsynced: list[Write] = field(default_factory=list)
    size: int = 0
    changed: int = 0  # entries of the journal up to the last one about it

    def write(self, offset: int, data: bytes) -> None:
        """Bytes at an offset."""
        self.unsynced.append(Write(offset, data))
        self.size = max(self.size, offset + len(data))

    def grown(self) -> bool:
        """Whether unsynced writes reach beyond the bytes on the disk."""
        ends = [write.offset + len(write.data) for write in self.unsynced if write.data]
        return max(ends, default=0) > len(self.synced)

    def sync(self, count: int) -> None:
        """The first `count` of the unsynced writes are on the disk."""
        for write in self.unsynced[:count]:
            _apply(self.synced, write.offset, write.data)
        del self.unsynced[:count]

    def after_cut(self, rng: random.Random, kept: float) -> bytes:
        """The bytes after a cut that keeps each unsynced write with that probability."""
        found = bytearray(self.synced)
        for write in self.unsynced:
            offset, data = write.offset, write.data
            if write.kept if data is None else rng.random() < kept:
                _apply(found, offset, data)
            elif data and rng.random() < kept:  # a part of it
                start = rng.randrange(0, len(data), SECTOR)
                _apply(found, offset + start, data[start : start + SECTOR])
        return bytes(found)


@dataclass(slots=True)
class Folder:
    """A folder: its names as programs see them, and those on the disk."""

    names: Names = field(default_factory=dict)
    synced: Names = field(default_factory=dict)
    changed: int = 0  # as of a file


class Disk:
    """The folder `root` (empty at first) as calls change it."""

    def __init__(self, root: Path) -> None:
        self._root = PurePosixPath(root)
        self._top = Folder()
        self._journal: list[tuple[Folder, Names] | Write] = []
        self._kept = 0  # entries of the journal that are on the disk

    def holds(self, path: str) -> bool:
        """Whether a path is in the folder, or is the folder itself."""
        return PurePosixPath(path).is_relative_to(self._root)

    def at(self, path: str) -> File | Folder | None:
        """File or folder at a path, as programs see it."""
        node: File | Folder | None = self._top
        for name in PurePosixPath(path).relative_to(self._root).parts:
            node = node.names.get(name) if isinstance(node, Folder) else None
        return node

    def create(self, path: str) -> File:
        """A new, empty file."""
        file = File()
        self._change(path, file)
        file.changed = len(self._journal)
        return file

    def make_folder(self, path: str) -> None:
        """A new folder."""
        folder = Folder()
        self._change(path, folder)
        folder.changed = len(self._journal)

    def remove(self, path: str) -> None:
        """A file or folder loses its name."""
        self._change(path, None)

    def link(self, path: str, new: str) -> None:
        """A second name of a file."""
        self._change(new, self.at(path))

    def rename(self, path: str, new: str) -> None:
        """Another name, in place of what had it."""
        node, (old, other) = self.at(path), (PurePosixPath(path), PurePosixPath(new))
        if old.parent == other.parent:
            self._enter(self._parent(path), {old.name: None, other.name: node})
            return
        self._change(new, node)
        self._change(path, None)

    def truncate(self, file: File, size: int) -> None:
        """Another length of a file."""
        write = Write(size, None)
        file.unsynced.append(write)
        file.size = size
        self._journal.append(write)
        file.changed = len(self._journal)

    def sync(self, node: File | Folder, writes: int, entries: int) -> None:
        """A sync that began when the node had so many writes, and the journal so many entries."""
        until = node.changed
        if isinstance(node, File):
            until = entries if node.grown() else until
            node.sync(writes)
        self._keep(min(until, entries))

    @property
    def entries(self) -> int:
        """Entries of the journal so far."""
        return len(self._journal)

    def after_cut(self, to: Path, rng: random.Random, kept: float) -> None:
        """Write into `to` the folder that a cut now would leave; the disk is then of no more use.

        `kept` is the probability of each unsynced write to be there, and of each entry of the
        journal if the one before it is.
        """
        while self._kept < len(self._journal) and rng.random() < kept:
            self._keep(self._kept + 1)
        _make(self._top, to, rng, kept)

    def _keep(self, until: int) -> None:
        for entry in self._journal[self._kept : until]:
            if isinstance(entry, Write):
                entry.kept = True
            else:
                folder, names = entry
                _rename(folder.synced, names)
        self._kept = max(self._kept, until)

    def _change(self, path: str, node: File | Folder | None) -> None:
        self._enter(self._parent(path), {PurePosixPath(path).name: node})

    def _enter(self, folder: Folder, names: Names) -> None:
        _rename(folder.names, names)
        self._journal.append((folder, names))
        folder.changed = len(self._journal)

    def _parent(self, path: str) -> Folder:
        found = self.at(str(PurePosixPath(path).parent))
        assert isinstance(found, Folder), path
        return found


def _make(folder: Folder, to: Path, rng: random.Random, kept: float) -> None:
    to.mkdir()
    for name, node in folder.synced.items():
        if isinstance(node, Folder):
            _make(node, to / name, rng, kept)
        elif node is not None:
            (to / name).write_bytes(node.after_cut(rng, kept))


def _apply(content: bytearray, offset: int, data: bytes | None) -> None:
    if data is None:
        del content[offset:]
    content.extend(bytes(max(0, offset - len(content))))
    if data is not None:
        content[offset : offset + len(data)] = data


def _rename(names: Names, change: Names) -> None:
    for name, node in change.items():
        if node is None:
            names.pop(name, None)
        else:
            names[name] = node
