"""A map's folder while a process writes it: the connection between the writer and other processes.

The writer listens at a Unix socket, whose random name in Linux' abstract namespace stands in the
lock file of the map: it needs no file, ends with its process, and nobody can take its place. It
gives states of the store by hard links, at most `FRESH` seconds old, and makes the edits of other
processes as its own. Both sides first check that the other is a process of their own user
(SO_PEERCRED, `unix(7)`), and that the folder belongs to that user.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import socket
import struct
import threading
import time
import weakref
from multiprocessing.connection import Connection
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from kg.maps.conflict_check import apply_remote_update
from kg.maps.stored_map import StoredMap
from kg.model.errors import ConflictError, GraphError, HereaboutsError, MapBusyError
from kg.model.platforms import user
from kg.store.folder import announce, announced
from kg.store.snapshots import Snapshots

FRESH: Final = 1.0  # [s] greatest age of the state that a reader gets, of these parts:
_OLDEST: Final = 0.8  # [s] of a snapshot that a reader gets
_RENEWED: Final = 0.5  # [s] of a snapshot, when the next one is made while readers use it
CHECKED: Final = 0.2  # [s] between two questions of a reader whether there is a newer one
HELD: Final = 2.0  # [s] that another process may keep the writer from writing
PATIENCE: Final = 60.0  # [s] for an answer of the writer ...
_SOON: Final = 5.0  # ... and for a state of the map, which it gives without waiting for anything
AGAIN: Final = "run the command again, a search with --resume"  # where the writer has ended
_GREETING: Final = "hereabouts folder 1"
_GREETED: Final = 5.0  # [s]
APPLIED: Final = "records"  # a call that applies an update of records, as of a search
#: all calls of other processes; but for that one, by the part of the map
CALLS: Final = frozenset(
    (
        *(APPLIED, "apply_ground", "describe", "new_object_iri", "place_frame", "restore"),
        "update",
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
            if name not in CALLS:
                raise GraphError(f"a writer of a map makes no call {name!r} for others")
            if lost:
                raise ConflictError(f"the map was held for more than {HELD:g} s; try again")
            if name == APPLIED:
                return True, apply_remote_update(self._opened(), *arguments, **keywords)
            return True, attrgetter(name)(self._opened())(*arguments, **keywords)
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
                if not self._connection.poll(_SOON if name == "snapshot" else PATIENCE):
                    raise TimeoutError
                succeeded, result = self._connection.recv()
            except (EOFError, OSError) as error:
                self._connection.close()  # a late answer would be taken for that of another call
                raise MapBusyError(
                    f"the process that writes the map has ended or hangs; {AGAIN}"
                ) from error
        if not succeeded:
            raise result
        return result

    def close(self) -> None:
        """End the connection."""
        self._connection.close()


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
    return bool(uid == user())


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
