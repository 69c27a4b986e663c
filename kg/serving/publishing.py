"""Publishing: mirrors maps into a SPARQL 1.1 server, from a snapshot or the last transaction.

Each transaction is one update of the target. If the target does not acknowledge an update, the
publisher first reads from the target whether it was applied. So it continues at the right
transaction, whichever side failed.

The source is a state of a map, the target a server of published maps. Graphs
have the same names as in a map. The last published transaction of each map is a fact of
graph:published (``<map> here:sequence 254``), written in the same update as the transaction. Things
with IRIs of other origin are listed there as parts of the map (dcterms:hasPart), so that their
facts can be assigned to it. Ontology and common sense are stored once for all maps: missing quads
are added, and a change of any map's ontology changes that copy.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, Store, parse

from kg.history.storage.log import BACKGROUND
from kg.maps.facts.coordinate_frames import MapFrame, apart_from, is_one_frame, quads_in_one_frame
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from kg.model.errors import GraphError, HistoryError, RemoteError, UnreachableError
from kg.model.transactions import ChangeSet
from kg.rdf.skolem import named
from kg.serving.client.remote_map import RemoteMap
from kg.serving.opening import open_map
from kg.store.sparql_backend import SparqlBackend, graph_blocks
from kg.store.sparql_client import Solutions
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import complete_types, inferred_changes
from kg.store.virtuoso import MAX_QUADS

DUMP_WITHIN: Final = 600.0  # [s] to read a served map
MAX_DUMP: Final = 8 << 30  # [bytes]


@dataclass(frozen=True, slots=True)
class SourceSnapshot:
    """Quads of a map after transaction `sequence`, without blank nodes and the number."""

    sequence: int
    quads: tuple[Quad, ...]


def snapshot_of(semantic_map: SemanticMap) -> SourceSnapshot:
    """The current state of a map; raises RemoteError if its server breaks off."""
    sequence, quads = 0, []
    for quad in _stored(semantic_map):
        if quad.predicate.value == v.SEQUENCE and isinstance(quad.object, Literal):
            sequence = int(quad.object.value)
        else:
            quads.append(quad)
    return SourceSnapshot(sequence, tuple(named(quads)))


def _stored(semantic_map: SemanticMap) -> Iterable[Quad]:
    if not isinstance(semantic_map, RemoteMap):
        return semantic_map.engine
    dump = semantic_map.dump(seconds=DUMP_WITHIN, max_bytes=MAX_DUMP)
    return parse(dump, format=RdfFormat.N_QUADS)


CHUNK: Final = 20_000  # quads of one request; a transaction of fewer is one update
CHUNK_OF_VIRTUOSO: Final = 10 * MAX_QUADS

_SEQUENCE: Final = NamedNode(v.SEQUENCE)
_PART: Final = NamedNode(v.DCT_HAS_PART)


class PublishTarget:
    """The server at `url`; safe to use from several threads.

    Raises RemoteError if there is no SPARQL server.
    """

    def __init__(self, url: str, token: str | None = None) -> None:
        self._engine = SparqlBackend(url, token=token)
        self._endpoint = self._engine.endpoint
        self.where = self._endpoint.where

    def acknowledged(self, base: str) -> int | None:
        """The last published transaction of the map `base`; None if there is none.

        None also for a copy without inferred types, which an earlier version published.
        """
        types = (
            f"GRAPH {v.INFERRED_GRAPH} {{ ?s ?p ?o }} FILTER(STRSTARTS(STR(?s), {Literal(base)}))"
        )
        return self._marks().get(base) if self._endpoint.ask(f"ASK {{ {types} }}") else None

    def synchronise(self, base: str, snapshot: SourceSnapshot) -> int:
        """Make the published copy equal to a snapshot; returns the number of quads written.

        A large copy takes several requests; the last one marks it as complete. Raises GraphError if
        the IRI of another published map begins with the IRI of this one, or the other way round.
        """
        marks = self._marks()
        _check_not_nested(base, marks.keys() - {base})
        own = set(_own(snapshot.quads))
        background = [quad for quad in snapshot.quads if quad not in own]
        stored = set(self._stored(base))
        known = {
            quad
            for graph in (*BACKGROUND, v.INFERRED_GRAPH)
            for quad in self._quads(f"BIND({graph} AS ?g) GRAPH {graph} {{ ?s ?p ?o }}")
        }
        delete = sorted(stored - own, key=str)
        insert = [quad for quad in background if quad not in known]
        insert += sorted(own - stored, key=str)
        self._write(base, delete, insert, marks.get(base), snapshot.sequence)
        return len(delete) + len(insert)

    def apply(self, base: str, change: ChangeSet, acknowledged: int) -> None:
        """Apply one transaction of a map whose transactions up to `acknowledged` are published."""
        removed, added = list(named(change.removed)), list(named(change.added))
        gone, new = inferred_changes(self._engine, removed, added)
        self._write(base, removed + gone, added + new, acknowledged, change.sequence)

    def apart_from(self, base: str) -> tuple[MapFrame, ...]:
        """The published maps whose frames have no known way to the frame of the map `base`."""
        described = Store()
        described.extend(self._quads(f"BIND({v.DATASET_GRAPH} AS ?g) GRAPH ?g {{ ?s ?p ?o }}"))
        return apart_from(described, base)

    def close(self) -> None:
        """Close the connections."""
        self._endpoint.close()

    def _marks(self) -> dict[str, int]:
        pattern = f"GRAPH {v.PUBLISHED_GRAPH} {{ ?map {_SEQUENCE} ?number }}"
        found: dict[str, int] = {}
        for row in self._select("?map ?number", pattern).rows:
            base, number = row["map"].value, int(row["number"].value)
            # a server that applies updates in part may have two: the earlier one is safe
            found[base] = min(number, found.get(base, number))
        return found

    def _stored(self, base: str) -> Iterator[Quad]:
        """Published quads of a map, except ontology and common sense."""
        others = ", ".join(map(str, (*BACKGROUND, v.PUBLISHED_GRAPH)))
        facts = f"GRAPH ?g {{ ?s ?p ?o }} FILTER(?g NOT IN ({others}))"
        yield from self._quads(f"{facts} FILTER(STRSTARTS(STR(?s), {Literal(base)}))")
        part = f"GRAPH {v.PUBLISHED_GRAPH} {{ {NamedNode(base)} {_PART} ?s }}"
        yield from self._quads(f"{part} {facts}")

    def _quads(self, pattern: str) -> Iterator[Quad]:
        (count,) = self._select("(COUNT(*) AS ?n)", pattern).rows
        answer = self._select("?s ?p ?o ?g", pattern)
        if len(answer.rows) < int(count["n"].value):
            raise RemoteError(
                f"{self.where} gives {len(answer.rows)} of {count['n'].value} rows; raise the "
                "largest number of rows it answers with (Virtuoso: ResultSetMaxRows)"
            )
        for row in answer.rows:
            yield Quad(row["s"], row["p"], row["o"], row["g"])

    def _select(self, what: str, pattern: str) -> Solutions:
        answer = self._endpoint.ask(f"SELECT {what} WHERE {{ {pattern} }}")
        if not isinstance(answer, Solutions):
            raise RemoteError(f"{self.where} answered a SELECT with something else")
        return answer

    def _write(
        self,
        base: str,
        delete: Iterable[Quad],
        insert: Iterable[Quad],
        before: int | None,
        sequence: int,
    ) -> None:
        insert = tuple(insert)
        steps = [("DELETE", tuple(delete)), ("INSERT", (*_parts(base, insert), *insert))]
        chunk = CHUNK_OF_VIRTUOSO if self._endpoint.virtuoso else CHUNK
        operations: list[str] = []
        waiting = 0
        for verb, quads in steps:
            for start in range(0, len(quads), chunk):
                part = quads[start : start + chunk]
                if waiting + len(part) > chunk:
                    self._endpoint.update(";\n".join(operations))
                    operations, waiting = [], 0
                operations.append(_operation(verb, part))
                waiting += len(part)
        if before is not None:
            operations.append(_operation("DELETE", (_mark(base, before),)))
        operations.append(_operation("INSERT", (_mark(base, sequence),)))
        self._endpoint.update(";\n".join(operations))


def _operation(verb: str, quads: Iterable[Quad]) -> str:
    return f"{verb} DATA {{\n{graph_blocks(quads)}}}"


def _mark(base: str, sequence: int) -> Quad:
    return Quad(NamedNode(base), _SEQUENCE, Literal(sequence), v.PUBLISHED_GRAPH)


def _parts(base: str, quads: Iterable[Quad]) -> dict[Quad, None]:
    """Quads that mark resources with other IRIs as parts of the map."""
    return {
        Quad(NamedNode(base), _PART, quad.subject, v.PUBLISHED_GRAPH): None
        for quad in quads
        if quad.graph_name not in (*BACKGROUND, v.INFERRED_GRAPH)
        and isinstance(quad.subject, NamedNode)
        and not quad.subject.value.startswith(base)
    }


def _own(quads: Iterable[Quad]) -> Iterator[Quad]:
    """The facts of a map, with the inferred types of the things that have facts."""
    facts = [q for q in quads if q.graph_name not in (*BACKGROUND, v.INFERRED_GRAPH)]
    things = {quad.subject for quad in facts}
    yield from facts
    yield from (q for q in quads if q.graph_name == v.INFERRED_GRAPH and q.subject in things)


def _check_not_nested(base: str, others: Iterable[str]) -> None:
    for other in others:
        if other.startswith(base) or base.startswith(other):
            raise GraphError(
                f"the map {base} cannot be published beside {other}: the IRI of one begins with "
                "that of the other, so their things cannot be distinguished"
            )


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
