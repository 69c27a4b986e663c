"""Transactional quad store on disk, with one writer at a time.

A map is a folder with Oxigraph's ``store/`` and a lock file ``lock``. A writer holds the lock
exclusively; readers share it, since Oxigraph does not support reading beside a writing process.
Readers write nothing into the folder.
Deletions leave tombstones that slow every query until a flush, so a thread of the writer flushes
every few seconds.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, Self

from pyoxigraph import NamedNode, Quad, Store

from kg.model.errors import GraphError
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import transaction_time
from kg.rdf.quad_store import QuadStore
from kg.store.folder import (
    check_is_map,
    check_vacant,
    disk_full,
    has_room,
    locked,
    new_folder,
    reopened,
    write_error,
)
from kg.store.scheduling import check_facts, keep_flushing
from kg.store.transaction_quads import (
    CommitListeners,
    Journal,
    check_blank_nodes,
    check_texts,
    sequence_quad,
    stored_sequence,
    update_text,
)
from kg.store.type_inference import complete_types, inferred_changes, is_inferred, with_types

LOADED: Final = 5000  # facts from which on they are loaded before the rest of a transaction


class TransactionalStore(CommitListeners):
    """An open store, also as a context manager.

    `engine` is for reading, `commit` writes. A `journal` records each transaction before the store
    applies it.
    """

    def __init__(
        self,
        engine: QuadStore,
        *,
        where: str,
        read_only: bool,
        lock: int | None,
        on_disk: bool = True,
    ) -> None:
        super().__init__()
        self._engine: QuadStore | None = engine
        self.where = where
        self.read_only = read_only
        self.journal: Journal | None = None
        self._sequence: int | None = None
        self._failed = False  # whether a write failed: the engine then refuses all further ones
        self._loaded: ChangeSet | None = None  # whose facts were loaded, while it is not complete
        self._unlock = weakref.finalize(self, os.close, lock) if lock is not None else None
        self._on_disk = on_disk
        self._copy: Path | None = None  # private folder with the files that are read instead
        flushed = lock is not None and not read_only
        self._stop_flushing = keep_flushing(self) if flushed else None

    @classmethod
    def in_memory(cls, quads: Iterable[Quad], *, read_only: bool = False) -> Self:
        """A store in memory; closing deletes it."""
        return cls(with_types(quads), where="memory", read_only=read_only, lock=None)

    @classmethod
    def create(cls, path: Path, quads: Iterable[Quad]) -> Self:
        """A new store of `quads` at `path`, open for writing.

        The store is built beside `path` and then renamed, so that a killed process leaves no
        incomplete map, and its name is on the disk. Raises GraphError if `path` exists.
        """
        check_vacant(path)
        try:
            with new_folder(path) as (building, lock):
                engine = Store(str(building / "store"))
                engine.bulk_extend(quads)
                complete_types(engine)
                engine.flush()
                del engine  # releases its files
            try:
                engine = Store(str(path / "store"))
            except BaseException:
                os.close(lock)
                raise
        except OSError as error:
            raise write_error(error, path, f"cannot create a map at {path}") from error
        return cls(engine, where=str(path), read_only=False, lock=lock)

    @classmethod
    def open(cls, path: Path, *, read_only: bool = False) -> Self:
        """The store at `path`.

        Raises:
            MapNotFoundError: there is no store; none is created.
            MapBusyError: another process (or another handle of this one) has the map open, and one
                of both wants to write.
        """
        check_is_map(path)
        lock = locked(path / "lock", path, shared=read_only)
        try:
            folder = str(path / "store")
            engine = Store.read_only(folder) if read_only else Store(folder)
            inferred = is_inferred(engine)
            if not inferred and read_only:
                engine = with_types(engine)  # since the folder cannot be written
            elif not inferred:
                complete_types(engine)
        except (OSError, RuntimeError) as error:  # RuntimeError: RocksDB finds damaged files
            os.close(lock)
            raise write_error(error, path, f"cannot open the map at {path}") from error
        on_disk = inferred or not read_only
        return cls(engine, where=str(path), read_only=read_only, lock=lock, on_disk=on_disk)

    @property
    def engine(self) -> QuadStore:
        """The live store; raises GraphError after `close`."""
        engine = self._engine
        if engine is None:
            with self._committing:  # it may be opening again
                engine = self._engine
        if engine is None:
            raise GraphError(f"the map at {self.where} is closed; open it again")
        return engine

    @property
    def path(self) -> Path | None:
        """The map's folder; None in memory and on a server."""
        return Path(self.where) if self._unlock is not None else None

    @property
    def on_disk(self) -> bool:
        """Whether the engine reads files of a folder, and no copy in memory."""
        return self._unlock is not None and self._on_disk

    @property
    def files(self) -> Path | None:
        """The folder whose store and history are read: the map's, or a private copy."""
        return self._copy or self.path

    @property
    def live(self) -> bool:
        """Whether the files beside the store are written meanwhile."""
        return not self.read_only

    def read_copy(self, copy: Path) -> None:
        """Read the store in `copy` from now on, which is removed when nobody needs it any more."""
        weakref.finalize(self, shutil.rmtree, copy, ignore_errors=True)
        self._copy, self._on_disk, self._sequence = copy, True, None
        self._engine = Store.read_only(str(copy / "store"))

    @property
    def shared(self) -> bool:
        """Whether other processes may write the store without a notification."""
        return False

    @property
    def native(self) -> Store:
        """The live embedded store; raises GraphError for a store on a server."""
        engine = self.engine
        assert isinstance(engine, Store)
        return engine

    def commit(
        self,
        delete: Iterable[Quad],
        insert: Iterable[Quad],
        cause: Cause,
        *,
        exact_at: int | None = None,
    ) -> ChangeSet | None:
        """Delete and insert quads in one atomic transaction.

        Args:
            delete: quads to delete; quads that the store does not hold are ignored.
            insert: quads to insert; quads that the store holds already are ignored.
            cause: reason of the transaction.
            exact_at: transaction at which all quads are real changes; the store is then not
                searched for them.

        Returns:
            The change set, or None without a real change.

        Raises:
            InvalidFactError: a quad has a blank node, or a text that XML cannot represent.
        """
        self.check_writable()
        self.recover()
        added, removed = tuple(insert), tuple(delete)
        with self._committing:
            if exact_at is None or exact_at != self.sequence:
                wanted = dict.fromkeys(added)
                added = tuple(quad for quad in wanted if quad not in self.engine)
                removed = tuple(
                    q for q in dict.fromkeys(removed) if q not in wanted and q in self.engine
                )
            if not added and not removed:
                return None
            check_facts(len(added) + len(removed))
            check_blank_nodes((*added, *removed))
            check_texts(added)
            # after the clock was set back, a transaction must not precede the previous one
            time = max(transaction_time(), self.journal.last_time if self.journal else 0.0)
            change = ChangeSet(self.sequence + 1, time, cause, added, removed)
            self._record(change)
            self._sequence = change.sequence
            self.notify(change)
        return change

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        if self._sequence is None:
            self._sequence = stored_sequence(self.engine)
        return self._sequence

    @contextlib.contextmanager
    def copied(self) -> Iterator[Store]:
        """A temporary copy of the store, on disk by hard links; deleted after the block."""
        if not self.on_disk:
            copy = Store()
            copy.bulk_extend(self.native)
            yield copy
            return
        folder = Path(self.where) / "scratch"
        shutil.rmtree(folder, ignore_errors=True)  # left by a killed process
        try:
            self.backup(folder)
            copy = Store(str(folder))
            yield copy
            del copy
        except OSError as error:
            raise write_error(error, self.where, f"cannot copy the map at {self.where}") from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def backup(self, folder: Path) -> None:
        """Copy the store to a new folder, by hard links; raises GraphError, as of a full disk."""
        try:
            with self._writing():
                self.native.backup(str(folder))
        except GraphError:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def recover(self) -> None:
        """After a failed write, open the store again as soon as its disk has space.

        Raises DiskFullError where it has none. Meanwhile the store can be read.
        """
        path = self.path
        if not self._failed or path is None or self.read_only:
            return
        with self._committing:
            if not has_room(path):
                raise disk_full(path)
            if self._failed and self._engine is not None:
                self._engine, self._sequence = None, None
                self._engine, error = reopened(path / "store")
                if error is not None:
                    raise self._unwritable(error) from error
                self._unload()
                self._failed = False

    def replay(self, change: ChangeSet) -> None:
        """Apply a transaction of the journal, without notification."""
        self.check_writable()
        with self._committing:
            self._write(change)
            self._sequence = change.sequence

    def rewrite_graph(self, graph: NamedNode, quads: Iterable[Quad]) -> None:
        """Replace the quads of a graph by equivalent ones without blank nodes; no transaction.

        For maps whose ontology was stored with blank nodes.
        """
        self.check_writable()
        with self._committing:
            self._update(f"CLEAR GRAPH {graph};\n{update_text((), quads)}")

    def _update(self, sparql: str) -> None:
        with self._writing():
            self.native.update(sparql)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Raise an error of the engine within the block as a GraphError, and note the failure."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError | RuntimeError) -> GraphError:
        self._failed = True
        return write_error(error, self.where, f"cannot write the map at {self.where}")

    def _record(self, change: ChangeSet) -> None:
        if self.journal is None:
            self._write(change)
            return
        self.journal.append(change)
        try:
            self._write(change)
        except GraphError:
            if self._loaded is not None:
                raise  # it stays in the journal until `recover` has removed what was loaded
            # on a full disk this may fail too; the next `append` then withdraws the transaction
            with contextlib.suppress(GraphError):
                self.journal.withdraw(change.sequence)
            raise

    def _write(self, change: ChangeSet) -> None:
        delete, insert = inferred_changes(self.engine, change.removed, change.added)
        whole = replace(change, added=(*change.added, *insert)) if insert else change
        removed, added = [*change.removed, *delete], [sequence_quad(change.sequence)]
        if len(whole.added) > LOADED and self._unlock is not None:
            self._load(whole)
        else:
            added += whole.added
        if self.sequence:
            removed.append(sequence_quad(self.sequence))
        self._update(update_text(removed, added))
        self._loaded = None

    def _load(self, change: ChangeSet) -> None:
        """Add many facts at once, in a third of the time of an update, before the rest of `change`.

        A process that ends before the rest is written finds `change` in the journal and completes
        it. Readers see the facts a few milliseconds before the rest.
        """
        with self._writing():
            self.native.bulk_extend(change.added)
        self._loaded = change

    def _unload(self) -> None:
        """Remove the facts of a transaction that was not completed."""
        if self._loaded is not None:
            self._update(update_text(self._loaded.added, ()))
            if self.journal is not None:
                self.journal.withdraw(self._loaded.sequence)
            self._loaded = None

    def check_writable(self) -> None:
        """Raises GraphError if the store is read-only."""
        if self.read_only:
            raise GraphError(f"the map at {self.where} is open for reading only; open it to write")

    def flush(self) -> None:
        """Write everything to disk and drop tombstones; does nothing for readers.

        Raises GraphError on failure, such as a full disk.
        """
        self.recover()
        if self._engine is not None and self._unlock is not None and not self.read_only:
            with self._writing():
                self.native.flush()
            if self.journal is not None:
                self.journal.flush()

    def close(self) -> None:
        """Flush, stop the thread, release store and lock; idempotent.

        Raises GraphError, after the release, if the flush fails.
        """
        if self._stop_flushing is not None:
            self._stop_flushing()
        try:
            self.flush()
        finally:
            if self.journal is not None:
                self.journal.close()
                self.journal = None
            self._engine = None
            if self._unlock is not None:
                self._unlock()
            if self._copy is not None:
                shutil.rmtree(self._copy, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
