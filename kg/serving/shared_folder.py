"""A map's folder while a process writes it: other processes of its user read and edit through it.

The writer listens at a Unix socket, whose random name in Linux' abstract namespace stands in the
lock file of the map: it needs no file, ends with its process, and nobody can take its place. A
reader asks there for a state of the store by hard links, at most `FRESH` seconds old, and reads the
databases beside it while they are written, as SQLite's write-ahead logs allow. Edits of persons are
calls that the writer makes as its own. Both sides first check that the other is a process of their
own user (SO_PEERCRED, `unix(7)`), and that the folder belongs to that user.
"""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import shutil
import socket
import struct
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from pyoxigraph import Store

from kg.history.storage.log import HistoryLog
from kg.history.storage.recovery import FILE, attach
from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.map_metadata import identity
from kg.maps.stored_map import StoredMap
from kg.maps.surface.surface_store import SurfaceStore
from kg.model.errors import ConflictError, GraphError, HereaboutsError, MapBusyError
from kg.model.transactions import ChangeSet
from kg.store.disk_space import write_error
from kg.store.folder import announce, announced, copy_files
from kg.store.snapshots import Snapshots, make_home, remove_home
from kg.store.transaction_quads import stored_sequence
from kg.store.transactional import TransactionalStore

FRESH: Final = 1.0  # [s] greatest age of the state that a reader gets, of these parts:
_OLDEST: Final = 0.8  # [s] of a snapshot that a reader gets
_RENEWED: Final = 0.5  # [s] of a snapshot, when the next one is made while readers use it
_CHECKED: Final = 0.2  # [s] between two questions of a reader whether there is a newer one
HELD: Final = 2.0  # [s] that another process may keep the writer from writing
PATIENCE: Final = 60.0  # [s] for an answer of the writer
_GREETING: Final = "hereabouts folder 1"
_GREETED: Final = 5.0  # [s]
#: calls of other processes, by the part of the map
_CALLS: Final = frozenset(
    (
        *("apply_ground", "describe", "place_frame", "restore", "update"),
        *("assertions.add", "assertions.retract", "rooms.edit"),
        *("history.compact", "ontology.learn", "ontology.replace", "ontology.write"),
    )
)


class FolderServer:
    """The writer's side: serves other processes of this user until `close`.

    On other systems than Linux, and where nobody may write the lock file, it serves nobody.
    """

    def __init__(self, semantic_map: StoredMap, folder: Path) -> None:
        self._map = weakref.ref(semantic_map)  # an open map that nobody holds is freed
        self._snapshots: Snapshots | None = None
        self._making = threading.Lock()
        self._idle = threading.Lock()  # held while the next snapshot is made
        self._ended = False
        self._listener: socket.socket | None = None
        if not hasattr(socket, "SO_PEERCRED"):
            return
        name = f"hereabouts-{secrets.token_hex(16)}"
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            listener.bind(f"\0{name}")
            listener.listen()
            announce(folder, name)
        except OSError:
            listener.close()
            return
        self._listener = listener
        self._closed = weakref.finalize(self, _end, listener)
        threading.Thread(target=_accept, args=(weakref.ref(self), listener), daemon=True).start()

    def close(self) -> None:
        """Serve no more; idempotent."""
        self._ended = True
        if self._listener is not None:
            self._closed()
        with self._making:
            if self._snapshots is not None:
                self._snapshots.close()

    def serve(self, connection: Connection) -> None:
        """Answer the requests of one process, until it ends."""
        until: float | None = None  # [s] on the monotonic clock, while the process holds the map
        lost = False
        with connection, contextlib.ExitStack() as held:
            connection.send(_GREETING)
            while True:
                if not connection.poll(None if until is None else max(0, until - time.monotonic())):
                    held.close()
                    until, lost = None, True
                    continue
                name, arguments, keywords = connection.recv()
                if name == "hold":
                    held.enter_context(self._opened().hold())
                    until, lost = time.monotonic() + HELD, False
                elif name == "release":
                    held.close()
                    until, lost = None, False
                answer = self._answer(name, arguments, keywords, lost=lost)
                if self._ended:
                    return
                connection.send(answer)

    def _answer(
        self, name: str, arguments: tuple[Any, ...], keywords: dict[str, Any], *, lost: bool
    ) -> tuple[bool, Any]:
        """Whether a request succeeded, and its result or error, of wrong arguments too."""
        try:
            if name in ("hold", "release", "sequence"):
                return True, self._opened().sequence
            if name == "snapshot":
                return True, self._snapshot(*arguments)
            if name not in _CALLS:
                raise GraphError(f"a writer of a map makes no call {name!r} for others")
            if lost:
                raise ConflictError(f"the map was held for more than {HELD:g} s; try again")
            part: Any = self._opened()
            for word in name.split("."):
                part = getattr(part, word)
            return True, part(*arguments, **keywords)
        except (HereaboutsError, AttributeError, LookupError, TypeError, ValueError) as error:
            return False, error

    def _snapshot(self, folder: str, at_least: int, known: int) -> bool:
        """Put the store's files into the new folder of a reader, if they have more than `known`."""
        store = self._opened().store
        with self._making:
            if self._snapshots is None:
                self._snapshots = Snapshots(store, refresh=_OLDEST)
        snapshot = self._snapshots.lease(at_least)
        try:
            if snapshot.sequence <= known:
                return False
            shutil.copytree(snapshot.folder, folder, copy_function=_linked)
        except OSError as error:
            raise GraphError(f"cannot make a snapshot at {folder}: {error.strerror}") from error
        finally:
            self._snapshots.release(snapshot)
            if time.monotonic() - snapshot.made > _RENEWED and self._idle.acquire(blocking=False):
                threading.Thread(target=self._renew, args=[self._snapshots], daemon=True).start()
        return True

    def _renew(self, snapshots: Snapshots) -> None:
        """Make the next snapshot, so that the next reader need not wait for it."""
        try:
            with contextlib.suppress(GraphError):  # the reader that waits for one gets the error
                snapshots.refresh()
        finally:
            self._idle.release()

    def _opened(self) -> StoredMap:
        semantic_map = self._map()
        if semantic_map is None:
            raise GraphError("the map is closed; open it again")
        return semantic_map


class FolderClient:
    """The side of a process that reads or edits a map which another one writes.

    Raises MapBusyError where no writer answers that this user may trust.
    """

    def __init__(self, path: Path) -> None:
        self._lock = threading.RLock()
        busy = f"the map at {path} is being written by a process"
        found = _connected(path)
        if found is None:
            raise MapBusyError(
                f"{busy} that does not serve this user; end it, or give the address of its "
                "`hereabouts serve`"
            )
        self._connection = found
        try:
            if not found.poll(_GREETED) or found.recv() != _GREETING:
                raise MapBusyError(f"{busy} that does not answer, or of another version; end it")
        except (EOFError, OSError) as error:
            raise MapBusyError(f"{busy} that ends just now; try again") from error

    def call(self, name: str, *arguments: object, **keywords: object) -> Any:
        """The result of a call that the writer makes; raises its error, or MapBusyError."""
        with self._lock:
            try:
                self._connection.send((name, arguments, keywords))
                if not self._connection.poll(PATIENCE):
                    raise TimeoutError
                succeeded, result = self._connection.recv()
            except (EOFError, OSError) as error:
                raise MapBusyError("the process that writes the map has ended or hangs") from error
        if not succeeded:
            raise result
        return result

    def close(self) -> None:
        """End the connection."""
        self._connection.close()


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
            raise MapBusyError(f"the process that wrote the map at {self.where} has ended")
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
            old = time.monotonic() - self._checked >= _CHECKED
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
                files = [path / FILE, path / f"{FILE}-wal", path / "store" / "CURRENT"]
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
            f"another process writes the map at {self.where}; names, assertions, rooms and updates "
            "go through it, frames and searches do not; end it first"
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

    def __init__(self, store: SharedStore, history: HistoryLog | None) -> None:
        super().__init__(store, history=history)
        store.on_renewal = self._renewed
        self._log, self._holds = history, 0
        if history is not None:
            history.refresh(store.sequence)
        if store.read_only:
            return
        for name in ("assertions", "rooms", "ontology", "history"):
            setattr(self, name, _Part(name, getattr(self, name), self._edit))

    @property
    def catalogue(self) -> Catalogue:
        """The categories of the present state's ontology."""
        self.store.renew()
        return super().catalogue

    def update(self, sparql: str, **keywords: Any) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update as one transaction of the writer."""
        change: ChangeSet | None = self._edit("update", sparql, **keywords)
        return change

    def apply_ground(
        self, update: Any, note: str, *, check: Callable[[], None] | None = None, **keywords: Any
    ) -> ChangeSet | None:
        """Apply an evaluated update as one transaction of the writer."""
        with self.hold() if check else contextlib.nullcontext():
            if check is not None:
                check()
            change: ChangeSet | None = self._edit("apply_ground", update, note, **keywords)
            return change

    def describe(self, **keywords: Any) -> ChangeSet | None:
        """Set title or licence as one transaction of the writer."""
        change: ChangeSet | None = self._edit("describe", **keywords)
        return change

    def place_frame(self, relative_to: str, T: Any, **keywords: Any) -> ChangeSet | None:
        """State the transform to another frame as one transaction of the writer."""
        change: ChangeSet | None = self._edit("place_frame", relative_to, T, **keywords)
        return change

    def restore(self, when: Any, **keywords: Any) -> Any:
        """Write a past state back as one transaction of the writer."""
        return self._edit("restore", when, **keywords)

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
        self.history.surface_area = self.surface_store.area


class _Part:
    """A part of a map whose edits are calls of the writer."""

    def __init__(self, name: str, part: object, call: Callable[..., Any]) -> None:
        self._name, self._part, self._call = name, part, call

    def __getattr__(self, name: str) -> Any:
        if f"{self._name}.{name}" in _CALLS:
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


def _connected(path: Path) -> Connection | None:
    """A connection to the writer of a map; None where this user has none that it may trust."""
    name = announced(path)
    if name is None or not hasattr(socket, "SO_PEERCRED"):
        return None
    peer = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        peer.settimeout(_GREETED)
        peer.connect(f"\0{name}")
        if _is_own(peer):
            peer.setblocking(True)
            return Connection(peer.detach())
    except OSError:
        pass
    peer.close()
    return None


def _is_own(peer: socket.socket) -> bool:
    """Whether the other end of a socket is a process of this user."""
    size = struct.calcsize("3i")
    _, uid, _ = struct.unpack("3i", peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    return bool(uid == os.geteuid())


def _accept(server: weakref.ref[FolderServer], listener: socket.socket) -> None:
    """Serve each process of this user in a thread, until the listener is closed."""
    while True:
        try:
            peer, _ = listener.accept()
        except OSError:
            return
        serving = server()
        if serving is None or not _is_own(peer):
            peer.close()
            continue
        connection = Connection(peer.detach())
        threading.Thread(target=_serve, args=(serving, connection), daemon=True).start()
        del serving


def _serve(server: FolderServer, connection: Connection) -> None:
    with contextlib.suppress(EOFError, OSError, GraphError):  # the process or the map has ended
        server.serve(connection)


def _end(listener: socket.socket) -> None:
    with contextlib.suppress(OSError):
        listener.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
    listener.close()


def _linked(source: str, to: str) -> None:
    """A hard link of a file of a snapshot, or a copy on another disk."""
    try:
        os.link(source, to)
    except OSError:
        shutil.copyfile(source, to)
