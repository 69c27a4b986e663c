"""Publisher: mirrors maps into a target, from a snapshot or from the last transaction.

Each transaction is one update of the target. If the target does not acknowledge an update, the
publisher first reads from the target whether it was applied. So it continues at the right
transaction, whichever side failed.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from kg.maps.facts.coordinate_frames import is_one_frame, quads_in_one_frame
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import GraphError, HistoryError, RemoteError, UnreachableError
from kg.model.transactions import ChangeSet
from kg.serving.client.remote_map import RemoteMap
from kg.serving.opening import open_map
from kg.serving.publishing.target import PublishTarget, snapshot_of
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import complete_types

PAUSES: Final = (0.2, 0.5, 1.0, 2.0)  # [s] before the 1st, 2nd, ... attempt after a failed one
ATTEMPTS: Final = 5  # that a server refuses in a row


class Publisher:
    """Mirrors the map at `address`, a folder or a running `hereabouts serve`, into a target.

    `report` receives a line for the log. `acknowledged` is the last transaction published.
    """

    def __init__(
        self, address: str, target: PublishTarget, report: Callable[[str], None] = lambda _: None
    ) -> None:
        self.address, self.acknowledged = address, 0
        self._target, self._report = target, report
        self._stopped = threading.Event()
        self._guard = threading.Lock()
        self._map: SemanticMap | None = None

    def publish(self) -> int:
        """Publish the current state; returns the number of its last transaction.

        Raises RemoteError if one of the servers fails, MapBusyError for a folder in use.
        """
        with self._opened() as semantic_map:
            self._catch_up(semantic_map)
        return self.acknowledged

    def follow(self) -> None:
        """Publish the map, then each further transaction, until `stop`.

        Waits for servers that do not answer. A folder is published once, since it has no writer
        while it is open here. Raises RemoteError after repeated refusals of a server.
        """
        refused = 0
        while not self._stopped.is_set():
            before = self.acknowledged
            try:
                with self._opened() as semantic_map:
                    self._catch_up(semantic_map)
                    if not isinstance(semantic_map, RemoteMap):
                        self._report(
                            f"{self.address} is a folder, published as of now; "
                            "serve it for changes to be followed"
                        )
                        return
                    if not self._stopped.is_set():
                        self._follow(semantic_map)
            except UnreachableError as error:
                self._report(f"{self.address} waits: {error}")
            except HistoryError:
                continue  # the history is too short: the next attempt compares all quads
            except RemoteError as error:
                refused = 0 if self.acknowledged > before else refused
                if refused + 1 >= ATTEMPTS:
                    raise
                self._report(f"{self.address} tries again: {error}")
            refused += 1
            self._stopped.wait(PAUSES[min(refused, len(PAUSES)) - 1])

    def stop(self) -> None:
        """End `follow`, from any thread, after the transaction in progress."""
        self._stopped.set()
        with self._guard:
            if self._map is not None:
                self._map.close()

    @contextlib.contextmanager
    def _opened(self) -> Iterator[SemanticMap]:
        with open_map(self.address, read_only=True) as semantic_map:
            with self._guard:
                self._map = semantic_map
            try:
                yield semantic_map
            finally:
                with self._guard:
                    self._map = None

    def _catch_up(self, semantic_map: SemanticMap) -> None:
        known = self._target.acknowledged(semantic_map.base)
        if known is not None and known <= semantic_map.sequence:
            try:
                self._apply_all(semantic_map, known)
                return
            except HistoryError:
                pass  # the history is too short: all quads are compared
        self._synchronise(semantic_map)

    def _synchronise(self, semantic_map: SemanticMap) -> None:
        snapshot = snapshot_of(semantic_map)
        written = self._target.synchronise(semantic_map.base, snapshot)
        self.acknowledged = snapshot.sequence
        self._report(
            f"{semantic_map.description.title} is published as of #{snapshot.sequence}: "
            f"{written} triples added or removed"
        )
        if apart := self._target.apart_from(semantic_map.base):
            others = ", ".join(frame.title for frame in apart)
            self._report(
                f"no way is known from {semantic_map.description.title} to the frame of {others}: "
                "find and distances keep them apart; `hereabouts describe` states a transform"
            )

    def _apply_all(self, semantic_map: SemanticMap, known: int) -> None:
        self.acknowledged = known
        for change in semantic_map.history.changes(known):
            self._apply(semantic_map.base, change)
        self._report(f"{semantic_map.description.title} is published as of #{self.acknowledged}")

    def _follow(self, semantic_map: RemoteMap) -> None:
        for change in semantic_map.subscriptions.follow(self.acknowledged):
            self._apply(semantic_map.base, change)
            if self._stopped.is_set():
                return

    def _apply(self, base: str, change: ChangeSet) -> None:
        self._target.apply(base, change, self.acknowledged)
        self.acknowledged = change.sequence


def merged(addresses: Sequence[str]) -> SemanticMap:
    """The maps at `addresses`, folders or servers, as one read-only map.

    IRIs are unique to each map, so their facts stay apart in the same graphs; relative IRIs of a
    query are those of the first map. Maps with a known transform to the frame of the first are
    moved into it; the others keep their own coordinates. Raises GraphError where two are the same
    map, or one cannot be read.
    """
    bases: dict[str, str] = {}
    store = TransactionalStore.in_memory((), read_only=True)
    for address in addresses:
        with open_map(address, read_only=True) as member:
            if member.base in bases:
                raise GraphError(
                    f"{address} is the same map as {bases[member.base]} ({member.base}); "
                    "give each map once"
                )
            bases[member.base] = address
            store.native.bulk_extend(snapshot_of(member).quads)
    if not bases:
        raise GraphError("no map to merge was given")
    complete_types(store.native)
    home = next(iter(bases))
    if is_one_frame(store.engine, home):
        return StoredMap(store, base=home)
    quads = quads_in_one_frame(store.engine, home, rest=True)
    return StoredMap(TransactionalStore.in_memory(quads, read_only=True), base=home)
