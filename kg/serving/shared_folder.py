"""Shared maps: a map that another process of this user writes, as a reader and editor has it.

A reader asks the writer (`kg.serving.folder_server`) for the store's files, and reads the databases
beside it while they are written, as SQLite's write-ahead logs allow. Edits of persons, and what a
search finds, are calls that the writer makes as its own.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from pyoxigraph import Store

from kg.history.storage.log import HistoryLog
from kg.history.storage.maintenance import FILE, attach
from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.map_metadata import identity
from kg.maps.stored_map import StoredMap
from kg.maps.subscriptions import StoredSubscriptions
from kg.maps.surface.surface_store import SurfaceStore
from kg.model.errors import GraphError, MapBusyError
from kg.model.records import MapUpdate
from kg.model.sqlite_files import LOG
from kg.model.transactions import Cause, ChangeSet
from kg.serving.folder_server import AGAIN, APPLIED, CALLS, CHECKED, FolderClient
from kg.store.folder import copy_files, write_error
from kg.store.snapshots import make_home, remove_home
from kg.store.transaction_quads import stored_sequence
from kg.store.transactional import TransactionalStore


class SharedStore(TransactionalStore):
    """The store of a map that other processes may write, as it was at most `FRESH` seconds ago.

    It reads hard links of the writer's files and, while nobody writes, of the map's own; so it
    keeps no writer out. With `writer` there must be one. Raises MapBusyError as `FolderClient`.
    """

    def __init__(self, path: Path, *, read_only: bool, writer: bool = True) -> None:
        self.on_renewal: Callable[[int, int], None] = lambda before, now: None
        self._renewing = threading.RLock()
        self._client: FolderClient | None = None
        self._copied: tuple[int, ...] = ()  # state of the files that were copied from the folder
        self._generation = self._number = 0
        self._checked = -math.inf  # [s] on the monotonic clock
        self.where = str(path)
        self._home, lock = make_home(path)
        self._remove = weakref.finalize(self, remove_home, self._home, lock)
        try:
            engine = self._from_writer(0) if writer else self._latest(0)
        except BaseException:
            self._remove()
            raise
        super().__init__(engine, where=self.where, read_only=True, lock=os.dup(lock))
        self.read_only = read_only

    @property
    def client(self) -> FolderClient:
        """The connection to the process that writes; raises MapBusyError if that has ended."""
        if self._client is None:
            raise MapBusyError(f"the process that wrote the map at {self.where} has ended; {AGAIN}")
        return self._client

    @property
    def log_file(self) -> Path:
        """The history that goes with the state."""
        return (Path(self.where) if self._client else self._home / str(self._generation)) / FILE

    @property
    def live(self) -> bool:
        """Whether the files beside the store are written meanwhile."""
        return True

    @property
    def shared(self) -> bool:
        """Whether other processes may write the store without a notification."""
        return True

    @property
    def files(self) -> Path:
        """The folder with the files of the present state."""
        self.renew()
        return self._home / str(self._generation)

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders that readers of the store and of the history open."""
        return Path(self.where), self._home

    @property
    def engine(self) -> Store:
        """The store as it was at most `FRESH` seconds ago; raises GraphError after `close`."""
        self.renew()
        if not isinstance(self._engine, Store):
            raise GraphError(f"the map at {self.where} is closed; open it again")
        return self._engine

    @property
    def sequence(self) -> int:
        """The number of the last transaction of that state."""
        self.renew()
        return self._number

    def renew(self, at_least: int | None = None) -> None:
        """Read a new state if the present one is too old, or lacks transaction `at_least`."""
        with self._renewing:
            old = time.monotonic() - self._checked >= CHECKED
            if self._engine is None or not (old if at_least is None else at_least > self._number):
                return
            before, generation = self._number, self._generation
            self._engine = self._latest(at_least or 0)
            if self._generation != generation:
                shutil.rmtree(self._home / str(generation), ignore_errors=True)
                self.on_renewal(before, self._number)

    def _latest(self, at_least: int) -> Store:
        self._checked = time.monotonic()
        try:
            return self._from_writer(at_least)
        except MapBusyError:
            self._client = None
            return self._without_writer()

    def _from_writer(self, at_least: int) -> Store:
        known = self._number if self._generation and self._client is not None else -1
        if self._client is None:
            self._client = FolderClient(Path(self.where))
        folder = self._home / str(self._generation + 1) / "store"
        folder.parent.mkdir(exist_ok=True)
        if self._client.call("snapshot", str(folder), at_least, known):
            return self._read(folder)
        assert isinstance(self._engine, Store)
        return self._engine

    def _without_writer(self) -> Store:
        """The state that the last writer left."""
        path, copy = Path(self.where), self._home / str(self._generation + 1)
        try:
            with contextlib.closing(TransactionalStore.open(path, read_only=True)):
                files = [path / FILE, path / f"{FILE}{LOG}", path / "store" / "CURRENT"]
                state = [file.stat() for file in files if file.exists()]
                copied = tuple(n for one in state for n in (one.st_mtime_ns, one.st_size))
                if copied != self._copied:
                    shutil.rmtree(copy, ignore_errors=True)
                    recover_copy(path, copy)
        except MapBusyError:  # a writer begins or ends
            if not self._generation:
                raise
            copied = self._copied
        if copied == self._copied:
            assert isinstance(self._engine, Store)
            return self._engine
        self._copied = copied
        return self._read(copy / "store")

    def _read(self, folder: Path) -> Store:
        engine = Store.read_only(str(folder))
        self._generation += 1
        self._number = stored_sequence(engine)
        return engine

    def backup(self, folder: Path) -> None:
        """Copy the writer's present state to a new folder."""
        self.client.call("snapshot", str(folder), 0, -1)

    def commit(self, *_: object, **__: object) -> ChangeSet | None:
        """Refused: the process that has the map writes it."""
        raise GraphError(
            f"another process writes the map at {self.where}; names, assertions, rooms, updates "
            "and searches go through it, frames do not; end it first"
        )

    def flush(self) -> None:
        """Nothing: the writer does."""

    def close(self) -> None:
        """End the connection, and remove the files of the state; idempotent."""
        super().close()
        if self._client is not None:
            self._client.close()
        self._remove()


class SharedMap(StoredMap):
    """A map that another process of this user writes; edits are calls of that process."""

    store: SharedStore
    subscriptions: SharedSubscriptions

    def __init__(self, store: SharedStore, history: HistoryLog | None) -> None:
        super().__init__(store, history=history)
        store.on_renewal = self._renewed
        self.subscriptions = SharedSubscriptions(self)
        self._log, self._holds = history, 0
        if history is not None:
            history.refresh(store.sequence)
        if store.read_only:
            return
        for name in ("update", "describe", "new_object_iri", "place_frame", "restore"):
            setattr(self, name, partial(self._edit, name))
        for name in ("assertions", "rooms", "ontology", "history"):
            setattr(self, name, _Part(name, getattr(self, name), self._edit))

    @property
    def catalogue(self) -> Catalogue:
        """The categories of the present state's ontology."""
        self.store.renew()
        return super().catalogue

    def apply_ground(
        self, update: Any, note: str, *, check: Callable[[], None] | None = None, **keywords: Any
    ) -> ChangeSet | None:
        """Apply an evaluated update as one transaction of the writer."""
        with self.hold() if check else contextlib.nullcontext():
            if check is not None:
                check()
            change: ChangeSet | None = self._edit("apply_ground", update, note, **keywords)
            return change

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Apply an update of a search as one transaction of the writer.

        Raises ConflictError, with nothing written, if others changed the same things since the last
        `subscriptions.catch_up`; GraphError for a frame.
        """
        if cause is None or cause.kind == "frame":
            return self.store.commit()
        read = self.subscriptions
        words: dict[str, Any] = {"known_sequence": read.sequence, "own": read.own}
        change: ChangeSet | None = self._edit(APPLIED, update, cause, **words)
        if change is not None:
            read.own.add(change.sequence)
        return change

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Keep the writer from writing for a block, for up to `HELD` seconds."""
        with super().hold():
            outermost = not self._holds and not self.store.read_only
            if outermost:
                self.store.renew(self.store.client.call("hold"))
            self._holds += 1
            try:
                yield
            finally:
                self._holds -= 1
                if outermost:
                    with contextlib.suppress(MapBusyError):  # the writer has ended
                        self.store.client.call("release")

    def close(self) -> None:
        """Close the map; the writer goes on."""
        self.store.read_only = True  # nothing is held to close
        super().close()

    def _edit(self, name: str, *arguments: Any, **keywords: Any) -> Any:
        self.store.check_writable()
        client = self.store.client
        result = client.call(name, *arguments, **keywords)
        self.store.renew(client.call("sequence"))
        return result

    def _renewed(self, before: int, now: int) -> None:
        if self._log is not None:
            self._log.move_to(self.store.log_file)
            self._log.refresh(now)
        if self._log is None or any(map(any, self._log.change_lines(before, now, background=True))):
            self.ontology.reread()
        self.surface_store = SurfaceStore(self.store.path, now, read_only=True, live=True)


class SharedSubscriptions(StoredSubscriptions):
    """Listeners of a shared map, up to transaction `sequence`; after it, `own` are its own ones."""

    def __init__(self, semantic_map: SharedMap) -> None:
        super().__init__(semantic_map.query, semantic_map.store)
        self._map = semantic_map
        self.sequence, self.own = semantic_map.store.sequence, set[int]()

    def catch_up(self) -> None:
        """Notify listeners of the commits of others so far."""
        store = self._map.store
        if store.read_only:
            return
        store.renew(store.client.call("sequence"))
        for change in self._map.history.changes(self.sequence):
            store.notify(change)
            self.sequence = change.sequence
        self.own.clear()

    def is_external(self, change: ChangeSet) -> bool:
        """Whether a transaction was not made by `apply` of this map."""
        return change.sequence not in self.own


class _Part:
    """A part of a map whose edits are calls of the writer."""

    def __init__(self, name: str, part: object, call: Callable[..., Any]) -> None:
        self._name, self._part, self._call = name, part, call

    def __getattr__(self, name: str) -> Any:
        if f"{self._name}.{name}" in CALLS:
            return partial(self._call, f"{self._name}.{name}")
        return getattr(self._part, name)


def recover_copy(path: Path, copy: Path) -> None:
    """Copy the map at `path`, which is locked, and apply the transactions that its store lacks."""
    try:
        copy_files(path, copy)
        with TransactionalStore.open(copy) as copied:
            attach(copied, copy, identity(copied), sets_aside=False)
    except OSError as error:
        raise write_error(error, copy, f"cannot copy the map at {path} to {copy}") from error
