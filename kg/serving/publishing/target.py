"""Source and target of a mirror: a state of a map, and a SPARQL 1.1 server of published maps.

Graphs have the same names as in a map. The last published transaction of each map is a fact of
graph:published (``<map> here:sequence 254``), written in the same update as the transaction. Things
with IRIs of other origin are listed there as parts of the map (dcterms:hasPart), so that their
facts can be assigned to it. Ontology and common sense are stored once for all maps: missing quads
are added, and a change of any map's ontology changes that copy.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, Store, parse

from kg.history.storage.log import BACKGROUND
from kg.maps.facts.coordinate_frames import MapFrame, apart_from
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import GraphError, RemoteError
from kg.model.transactions import ChangeSet
from kg.rdf.skolem import named
from kg.serving.client.remote_map import RemoteMap
from kg.store.sparql_backend import SparqlBackend, graph_blocks
from kg.store.sparql_client import Solutions
from kg.store.type_inference import inferred_changes
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
