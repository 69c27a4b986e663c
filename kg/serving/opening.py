"""Opening maps: a folder, memory, a SPARQL server, or a running `hereabouts serve`."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from kg.history.storage.log import HistoryLog
from kg.history.storage.maintenance import FILE, attach, open_history_read_only
from kg.knowledge.ontology.catalogue import Catalogue, shipped_ontology
from kg.maps.map_metadata import first_quads, identity
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import GraphError, MapBusyError
from kg.model.sqlite_files import has_log
from kg.store.folder import check_is_map, is_url
from kg.store.sparql_backend import ServerStore
from kg.store.sparql_client import without_secrets
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    from kg.serving.shared_folder import SharedMap

PATIENCE: Final = 3.0  # [s] for a folder in use
_PAUSE: Final = 0.02  # [s]


def create_map(
    path: Path | str,
    *,
    title: str | None = None,
    base: str | None = None,
    power_safe: bool = False,
) -> StoredMap:
    """Create a map with the shipped ontologies in the folder `path`.

    Creation is atomic, even if the process is killed. With `power_safe` each transaction waits for
    the disk, and so survives a power cut. Raises GraphError if a map exists there, and for the
    address of a server: `publish` mirrors maps into one.
    """
    if is_url(path):
        where = without_secrets(str(path))
        raise _not_written_there(
            f"maps are created in folders, not on the server at {where}", where
        )
    path, ontology = Path(path), shipped_ontology()
    store = TransactionalStore.create(
        path, first_quads(title or path.resolve().name, base, ontology)
    )
    return _with_history(store, path, power_safe, ontology.catalogue)


def open_map(
    path: Path | str,
    *,
    read_only: bool = False,
    power_safe: bool = False,
    exclusive: bool = False,
) -> SemanticMap:
    """Open the map in the folder, or on the server, at `path` (``http://127.0.0.1:7878``).

    After a crash, transactions that are missing in the store are first applied from the history;
    with `read_only` to a private copy, since reading writes nothing into the folder.
    `power_safe` is as for `create_map`. A running `hereabouts serve` gives a
    `kg.serving.client.remote_map.RemoteMap`: past states can be queried, and all writes go through
    the server. Maps published into any other SPARQL server are read there, with `read_only`.

    A folder that another process of this user writes gives a
    `kg.serving.shared_folder.SharedMap`: each query reads a state that is at most a second old, and
    edits (assertions, names, rooms, updates, descriptions) and searches are made by that process,
    but not frames. With `exclusive` this process alone writes.

    - MapNotFoundError: there is no map; nothing is created
    - MapBusyError: another process reads the folder while this one would write all by itself; or
      another user's process, or one on another machine, writes it
    - RemoteError: no server answers
    - GraphError: a server that is not a `hereabouts serve` is opened for writing
    """
    if is_url(path):
        return _on_server(ServerStore(str(path), read_only=read_only))
    path, until = Path(path), time.monotonic() + PATIENCE
    while True:
        try:
            if read_only:
                return _for_reading(path)
            return _with_history(TransactionalStore.open(path), path, power_safe)
        except MapBusyError as busy:
            with contextlib.suppress(MapBusyError):
                if not exclusive:
                    return _shared(path, read_only=read_only)
            if time.monotonic() > until:
                raise busy from None
        time.sleep(_PAUSE)  # a writer begins or ends, or a reader answers its question


def watch_map(path: Path | str) -> SemanticMap:
    """The map at `path` for reading over hours: others may begin and end to write it meanwhile.

    Each query reads a state that is at most a second old. Raises as `open_map`.
    """
    if is_url(path):
        return open_map(path, read_only=True)
    check_is_map(Path(path))
    until = time.monotonic() + PATIENCE
    while True:
        try:
            return _shared(Path(path), read_only=True, writer=False)
        except MapBusyError:
            if time.monotonic() > until:
                raise
        time.sleep(_PAUSE)


def open_or_create_map(
    path: Path | str,
    *,
    title: str | None = None,
    base: str | None = None,
    power_safe: bool = False,
) -> SemanticMap:
    """Open the map at `path` for writing; a folder without a map gets one with `title`, `base`."""
    if is_url(path):
        return open_map(path)
    path = Path(path)
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        return open_map(path, power_safe=power_safe, exclusive=True)
    return create_map(path, title=title, base=base, power_safe=power_safe)


def in_memory_map(*, title: str = "map", base: str | None = None) -> StoredMap:
    """Create a map without a path, for tests and simulations of a few thousand frames."""
    ontology = shipped_ontology()
    store = TransactionalStore.in_memory(first_quads(title, base, ontology))
    return _with_history(store, None, False, ontology.catalogue)


def _for_reading(path: Path) -> StoredMap:
    store = TransactionalStore.open(path, read_only=True)
    if not has_log(path / FILE):
        log = _history(store, path, power_safe=False)
        if log is None or log.last <= store.sequence:
            with _closed_on_error(store):
                return StoredMap(store, history=log)
        log.close()
    from kg.serving.shared_folder import recover_copy  # after a crash alone

    copy = Path(tempfile.mkdtemp(prefix="hereabouts-"))
    try:
        with _closed_on_error(store):
            recover_copy(path, copy)
            store.read_copy(copy)
    except BaseException:
        shutil.rmtree(copy, ignore_errors=True)
        raise
    return _with_history(store, copy, False)


def _shared(path: Path, *, read_only: bool, writer: bool = True) -> SharedMap:
    # a reader of a map that nobody writes needs no connections
    from kg.serving.shared_folder import SharedMap, SharedStore

    store = SharedStore(path, read_only=read_only, writer=writer)
    with _closed_on_error(store):
        log = open_history_read_only(store, store.log_file.parent, identity(store))
        return SharedMap(store, log)


def _with_history(
    store: TransactionalStore,
    folder: Path | None,
    power_safe: bool,
    catalogue: Catalogue | None = None,
) -> StoredMap:
    log = _history(store, folder, power_safe=power_safe)
    with _closed_on_error(store):
        semantic_map = StoredMap(store, catalogue=catalogue, history=log)
    if folder is not None and not store.read_only:
        from kg.serving.folder_server import FolderServer  # as above

        semantic_map.on_close.append(FolderServer(semantic_map, folder).close)
    return semantic_map


def _history(
    store: TransactionalStore, folder: Path | None, *, power_safe: bool
) -> HistoryLog | None:
    with _closed_on_error(store):
        base = identity(store)
        if not store.read_only:
            return attach(store, folder, base, power_safe=power_safe)
        return open_history_read_only(store, folder, base) if folder else None


@contextlib.contextmanager
def _closed_on_error(store: TransactionalStore) -> Iterator[None]:
    try:
        yield
    except BaseException:
        store.close()
        raise


def _on_server(store: TransactionalStore) -> SemanticMap:
    from kg.serving.client.remote_map import RemoteMap  # a map in a folder needs no HTTP client

    with _closed_on_error(store):
        if (found := RemoteMap.found_at(store)) is not None:
            return found
        if not store.read_only:
            raise _not_written_there(
                f"the server at {store.where} is no `hereabouts serve`, so its maps are only read",
                store.where,
            )
        return StoredMap(store)


def _not_written_there(fault: str, where: str) -> GraphError:
    remedy = f"map into a folder, then mirror it: hereabouts publish FOLDER --to {where}"
    return GraphError(f"{fault}; {remedy}")
