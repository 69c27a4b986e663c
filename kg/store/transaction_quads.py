"""Parts of a transaction: checks of its quads, the quad with its number, listeners, the journal."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Final, Protocol

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, RdfFormat, serialize

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.transactions import ChangeSet, Listener
from kg.rdf.literals import unwritable
from kg.rdf.quad_store import QuadStore

MAX_TEXT: Final = 100_000  # characters of one text, but for the cells of the floor
MAX_NAME: Final = 500  # characters of a label or title
MAX_IRI: Final = 8_000  # characters
_BINARY: Final = v.XSD + "base64Binary"
_NAMES: Final = {v.RDFS_LABEL, v.DCT_TITLE}


def update_text(delete: Iterable[Quad], insert: Iterable[Quad]) -> str:
    """SPARQL Update that deletes and inserts quads of named graphs.

    TriG differs from it only in that no GRAPH is before the name of a graph; the engine writes it
    in half of the time of single triples, with strings on one line.
    """
    parts = []
    for verb, quads in (("DELETE", delete), ("INSERT", insert)):
        text = (serialize(quads, format=RdfFormat.TRIG) or b"").decode()
        if text:
            graphs = f"\n{text}".replace("\n<", "\nGRAPH <")
            parts.append(f"{verb} DATA {{{graphs}}}")
    return ";\n".join(parts)


def check_blank_nodes(quads: Iterable[Quad]) -> None:
    """Raise InvalidFactError for a blank node.

    An update renames the blank nodes that it inserts, and it cannot delete any.
    """
    for quad in quads:
        if isinstance(quad.subject, BlankNode) or isinstance(quad.object, BlankNode):
            raise InvalidFactError(f"a blank node cannot be written: {quad.triple}; give it an IRI")


def check_texts(quads: Iterable[Quad]) -> None:
    """Raise InvalidFactError for a text or IRI that is too long, or that XML cannot represent.

    The limits of an ontology's texts are the same, so that what was written can be written again.
    """
    for quad in quads:
        value = quad.object
        if len(quad.subject.value) > MAX_IRI or len(quad.predicate.value) > MAX_IRI:  # type: ignore[union-attr]
            raise _too_long("an IRI", quad.subject.value, MAX_IRI)  # type: ignore[union-attr]
        if isinstance(value, NamedNode):
            if len(value.value) > MAX_IRI:
                raise _too_long("an IRI", value.value, MAX_IRI)
        elif isinstance(value, Literal):
            text = value.value
            if len(text) > MAX_NAME or not text.isprintable():
                _check_literal(quad, value)


def _check_literal(quad: Quad, value: Literal) -> None:
    text = value.value
    if len(text) > MAX_NAME and value.datatype.value != _BINARY:
        is_name = quad.predicate.value in _NAMES and quad.graph_name != v.ONTOLOGY_GRAPH
        limit = MAX_NAME if is_name else MAX_TEXT
        if len(text) > limit:
            raise _too_long(f"{quad.predicate} of {quad.subject}", text, limit)
    if (character := unwritable(text)) is not None:
        raise InvalidFactError(
            f"a text with {character} cannot be written, since XML cannot represent it: "
            f"{text[:60]!r}, {quad.predicate} of {quad.subject}; leave that character out"
        )


def _too_long(what: str, text: str, limit: int) -> InvalidFactError:
    return InvalidFactError(
        f"{what[:200]} has {len(text):,} characters: {text[:60]!r}...; at most {limit:,} would work"
    )


def sequence_quad(number: int) -> Quad:
    """The quad that states the number of the last stored transaction."""
    graph = v.DATASET_GRAPH
    return Quad(graph, NamedNode(v.SEQUENCE), Literal(number), graph)


def stored_sequence(engine: QuadStore) -> int:
    """The number of the last transaction in a store; 0 before the first."""
    graph = v.DATASET_GRAPH
    quads = engine.quads_for_pattern(graph, NamedNode(v.SEQUENCE), None, graph)
    return max((int(q.object.value) for q in quads if isinstance(q.object, Literal)), default=0)


class CommitListeners:
    """Callables that get each transaction after its commit."""

    def __init__(self) -> None:
        self._listeners: list[Listener] = []
        self._committing = threading.RLock()  # held by a commit

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` after each commit; returns a function that removes it."""
        with self._committing:  # a commit that has begun is not one of those after
            self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    @contextmanager
    def watched(self) -> Iterator[list[ChangeSet]]:
        """A list that gets each transaction that is committed within the block."""
        changes: list[ChangeSet] = []
        stop = self.listen(changes.append)
        try:
            yield changes
        finally:
            stop()

    def notify(self, change: ChangeSet) -> None:
        """Call the listeners with a stored transaction."""
        for listener in tuple(self._listeners):
            listener(change)


class Journal(Protocol):
    """Write-ahead log: each transaction is recorded here before the store applies it."""

    last_time: float  # [s] of the last recorded transaction

    def append(self, change: ChangeSet) -> None:
        """Record a transaction; raises GraphError on failure."""

    def withdraw(self, sequence: int) -> None:
        """Remove that transaction and later ones, which the store rejected."""

    def flush(self) -> None:
        """Do background work, on the flushing thread."""

    def close(self) -> None:
        """Close the files."""
