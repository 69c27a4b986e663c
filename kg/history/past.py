"""The map as it was: whole, one thing, one class, or what changed in between."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.engine import Engine
from kg.errors import HistoryError
from kg.history.background import background_at
from kg.history.coding import Coded, decode_delta
from kg.history.instants import refuse_dropped
from kg.history.log import BACKGROUND, Log
from kg.history.moment import Moment, PastStore
from kg.history.naming import short, word
from kg.store import MapStore, sequence_quad


@dataclass(frozen=True, slots=True)
class Difference:
    """What the map says at one moment and not at another."""

    before: int  # sequence numbers
    after: int
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]

    def __len__(self) -> int:
        return len(self.added) + len(self.removed)

    def rows(self, base: str) -> list[tuple[str, str, str, str, str]]:
        """``+``, ``-`` or ``~``, thing, what of it, before and after; in words, by thing."""
        sides: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
        for side, quads in enumerate((self.removed, self.added)):
            for quad in quads:
                key = short(quad.subject, base), word(quad.predicate)
                sides.setdefault(key, ([], []))[side].append(short(quad.object, base))
        rows = []
        for (subject, what), (before, after) in sides.items():
            sign = "~" if before and after else "+" if after else "-"
            rows.append((sign, subject, what, _listed(before), _listed(after)))
        return sorted(rows, key=lambda row: (_natural(row[1]), row[2]))


def store_at(log: Log, engine: Callable[[], Engine], sequence: int) -> MapStore:
    """A store for reading only that says what the `engine` it is given said after `sequence`.

    It is made of log and engine as far as it is read: both must stay open.
    """
    return PastStore(Moment(log, engine, sequence))


def quads_at(log: Log, engine: Engine, sequence: int) -> Iterator[Quad]:
    """All that the map said after `sequence`, where `engine` says what it says now.

    The engine is read before the first quad comes.
    """
    yield from background_at(log, engine, sequence)
    yield from (q for q in _quads(log, log.nodes(), sequence) if not _is_background(q))
    if sequence:
        yield sequence_quad(sequence)
    refuse_dropped(log, sequence)


def state_of(log: Log, iri: str, sequence: int) -> tuple[Quad, ...]:
    """All quads about `iri` after `sequence`, but for ontology and common sense."""
    with log.lock:
        nodes = log.terms.nodes_of(named(iri))
        return tuple(sorted(_quads(log, nodes, sequence), key=str))


def members_at(log: Log, category: str, sequence: int) -> dict[str, tuple[Quad, ...]]:
    """What stood in the map as `category` after `sequence`: IRI to its quads, as `state_of`."""
    kind, found = NamedNode(v.RDF_TYPE), {}
    with log.lock:
        for node in log.members(named(category)):
            quads = tuple(sorted(_quads(log, [node], sequence), key=str))
            if any(q.predicate == kind and q.object == named(category) for q in quads):
                found[getattr(quads[0].subject, "value", "")] = quads
    return found


def difference(log: Log, before: int, after: int) -> Difference:
    """What changed between two transactions, whatever went back and forth in between."""
    if before > after:
        turned = difference(log, after, before)
        return Difference(before, after, turned.removed, turned.added)
    added: list[Quad] = []
    removed: list[Quad] = []
    for node in sorted(log.touched(before, after)):
        with log.lock:
            if log.terms.pair(node)[0] in BACKGROUND:
                gone, came = _net(log, node, before, after)
            else:
                old, new = log.facts(node, before), log.facts(node, after)
                gone, came = old - new, new - old
            added += log.terms.quads(node, sorted(came))
            removed += log.terms.quads(node, sorted(gone))
    refuse_dropped(log, before)
    return Difference(before, after, tuple(added), tuple(removed))


def _listed(values: list[str]) -> str:
    return ", ".join(sorted(values))


def _natural(text: str) -> tuple[str, int, str]:
    head, _, number = text.rpartition("/")
    return (head, int(number), "") if number.isascii() and number.isdigit() else (text, 0, text)


def _quads(log: Log, nodes: Iterable[int], sequence: int) -> Iterable[Quad]:
    for node in nodes:
        with log.lock:
            yield from log.terms.quads(node, log.facts(node, sequence))


def _net(log: Log, node: int, before: int, after: int) -> tuple[set[Coded], set[Coded]]:
    """What went and what came, of a node whose state at `before` is not kept."""
    gone: set[Coded] = set()
    came: set[Coded] = set()
    for sequence, data in log.history(node):
        if before < sequence <= after:
            delta = decode_delta(data)
            for coded in delta.removed:
                came.remove(coded) if coded in came else gone.add(coded)
            for coded in delta.added:
                gone.remove(coded) if coded in gone else came.add(coded)
    return gone, came


def _is_background(quad: Quad) -> bool:
    return quad.graph_name in BACKGROUND


def named(iri: str) -> NamedNode:
    """The node with that IRI; HistoryError for what is no absolute IRI."""
    try:
        return NamedNode(iri)
    except ValueError:
        raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None
