"""Point-in-time queries on the log: one thing at a moment, and the difference of two moments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pyoxigraph import NamedNode, Quad

from kg.errors import HistoryError
from kg.history.curies import short, word
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.storage.row_codec import Coded, decode_delta
from kg.history.timestamps import refuse_dropped


@dataclass(frozen=True, slots=True)
class Difference:
    """The quads that hold at one moment and not at another."""

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


def state_of(log: HistoryLog, iri: str, sequence: int) -> tuple[Quad, ...]:
    """All quads about `iri` after `sequence`, but for ontology and common sense."""
    with log.lock:
        nodes = log.terms.nodes_of(named(iri))
        return tuple(sorted(_quads(log, nodes, sequence), key=str))


def difference(log: HistoryLog, before: int, after: int) -> Difference:
    """What changed between two transactions, whatever went back and forth in between."""
    if before > after:
        turned = difference(log, after, before)
        return Difference(before, after, turned.removed, turned.added)
    added: list[Quad] = []
    removed: list[Quad] = []
    for node in sorted(log.touched(before, after)):
        with log.lock:
            if log.terms.pair(node)[0] in BACKGROUND:
                dropped, introduced = _net(log, node, before, after)
            else:
                old, new = log.facts(node, before), log.facts(node, after)
                dropped, introduced = old - new, new - old
            added += log.terms.quads(node, sorted(introduced))
            removed += log.terms.quads(node, sorted(dropped))
    refuse_dropped(log, before)
    return Difference(before, after, tuple(added), tuple(removed))


def _listed(values: list[str]) -> str:
    return ", ".join(sorted(values))


def _natural(text: str) -> tuple[str, int, str]:
    head, _, number = text.rpartition("/")
    return (head, int(number), "") if number.isascii() and number.isdigit() else (text, 0, text)


def _quads(log: HistoryLog, nodes: Iterable[int], sequence: int) -> Iterable[Quad]:
    for node in nodes:
        with log.lock:
            yield from log.terms.quads(node, log.facts(node, sequence))


def _net(log: HistoryLog, node: int, before: int, after: int) -> tuple[set[Coded], set[Coded]]:
    """The facts removed and added, of a node whose state at `before` is not kept."""
    dropped: set[Coded] = set()
    introduced: set[Coded] = set()
    for sequence, data in log.history(node):
        if before < sequence <= after:
            delta = decode_delta(data)
            for coded in delta.removed:
                introduced.remove(coded) if coded in introduced else dropped.add(coded)
            for coded in delta.added:
                dropped.remove(coded) if coded in dropped else introduced.add(coded)
    return dropped, introduced


def named(iri: str) -> NamedNode:
    """The node with that IRI; HistoryError for what is no absolute IRI."""
    try:
        return NamedNode(iri)
    except ValueError:
        raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None
