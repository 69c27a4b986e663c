"""Evaluated updates: ground quads to delete and insert, and their form between processes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from pyoxigraph import NamedNode, Quad, RdfFormat, Triple, parse, serialize

from kg.model import vocabulary as v
from kg.model.errors import ShapeError
from kg.rdf.quad_store import QuadStore


@dataclass(frozen=True, slots=True)
class QuadChange:
    """One operation: the quads it deletes, then those it inserts."""

    delete: tuple[Quad, ...]
    insert: tuple[Quad, ...]


@dataclass(frozen=True, slots=True)
class GroundUpdate:
    """The operations of an update; `reads` is true if they depend on the state of the map."""

    steps: tuple[QuadChange, ...]
    reads: bool = False

    def encode(self) -> tuple[dict[str, Any], bytes]:
        """A JSON-able head and N-Quads, for `decode` in another process.

        Raises ShapeError for triple terms, whose nesting another process might not survive.
        """
        quads = [quad for step in self.steps for quad in (*step.delete, *step.insert)]
        check_triple_terms(quads)
        counts = [[len(step.delete), len(step.insert)] for step in self.steps]
        body = serialize(quads, format=RdfFormat.N_QUADS) or b""
        return {"counts": counts, "reads": self.reads}, body

    @classmethod
    def decode(cls, head: dict[str, Any], body: bytes) -> GroundUpdate:
        """The update that was encoded."""
        quads = parse(body, format=RdfFormat.N_QUADS)
        return cls(tuple(_steps(head["counts"], quads)), head["reads"])


def update_text(delete: Iterable[Quad], insert: Iterable[Quad]) -> str:
    """SPARQL Update that deletes and inserts quads of named graphs, without blank nodes."""
    parts = [("DELETE DATA", tuple(delete)), ("INSERT DATA", tuple(insert))]
    return " ;\n".join(
        f"{verb} {{ {' '.join(f'GRAPH {q.graph_name} {{ {q.triple} }}' for q in quads)} }}"
        for verb, quads in parts
        if quads
    )


def why_unchanged(update: GroundUpdate, engine: QuadStore) -> str:
    """Why an update that changed nothing deleted nothing: its statement is in another graph, has
    another value, or does not exist; empty for an update without deletions."""
    deleted = [quad for step in update.steps for quad in step.delete]
    quad = next((quad for quad in deleted if not any(engine.quads_for_pattern(*quad))), None)
    if quad is None:  # none, or what is deleted is inserted again
        return ""
    subject, predicate, value, graph = quad
    triple = " ".join(map(_short, (subject, predicate, value)))
    same = engine.quads_for_pattern(subject, predicate, value, None)
    elsewhere = sorted({_short(q.graph_name) for q in islice(same, 100)})
    if elsewhere:
        return (
            f"{_short(graph)} has no statement {triple}; it is in {', '.join(elsewhere)}: "
            f"write GRAPH {elsewhere[0]} {{ ... }}"
        )
    others = engine.quads_for_pattern(subject, predicate, None, None)
    values = sorted({_short(q.object) for q in islice(others, 100)})
    found = f"; the map has the values {', '.join(values[:3])}" if values else ""
    return f"the map has no statement {triple}{found}"


def _short(term: object) -> str:
    return v.curie(term.value) if isinstance(term, NamedNode) else str(term)


def check_triple_terms(quads: Iterable[Quad]) -> None:
    """Raise ShapeError if a quad has a triple term."""
    for quad in quads:
        if isinstance(quad.object, Triple) or isinstance(quad.subject, Triple):
            raise ShapeError("the update is refused: triple terms <<( )>> are not used in maps")


def _steps(counts: Iterable[tuple[int, int]], quads: Iterator[Quad]) -> Iterator[QuadChange]:
    for deleted, inserted in counts:
        yield QuadChange(tuple(islice(quads, deleted)), tuple(islice(quads, inserted)))
