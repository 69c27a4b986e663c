"""Batch replay: the facts about many subjects at a moment, in columns.

`kg.history.replay.subject_replay` does the same for one subject; here a thousand subjects take as
long as some two hundred there.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kg.history.replay.column_decoding import NOTHING, ChangeColumns, Ints, TextColumns, decode_rows
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.storage.row_codec import STRING, Coded
from kg.store.writer_priority import yield_to_writer

AT_ONCE: Final = 20_000  # nodes decoded together; some 50 MB
HELD: Final = 500  # nodes read while a writer waits
_NEAREST = (
    "SELECT value, "
    "(SELECT max(sequence) FROM state WHERE node = value AND sequence <= :sequence), "
    "(SELECT min(sequence) FROM state WHERE node = value AND sequence > :sequence) "
    "FROM json_each(:nodes)"
)
_NODE, _FROM = "json_extract(near.value, '$[0]')", "json_extract(near.value, '$[1]')"
_STATES = (
    "SELECT node, data FROM json_each(:near) AS near "
    f"CROSS JOIN state ON node = {_NODE} AND sequence = {_FROM}"
)
_AFTER = (
    "SELECT node, data FROM json_each(:near) AS near CROSS JOIN change ON "
    f"node = {_NODE} AND sequence > {_FROM} AND sequence <= :sequence ORDER BY near.key, sequence"
)
_BEFORE = (
    "SELECT node, data FROM json_each(:near) AS near CROSS JOIN change ON "
    f"node = {_NODE} AND sequence > :sequence AND sequence <= {_FROM} "
    "ORDER BY near.key, sequence DESC"
)
_NODES = "SELECT id, subject, graph FROM node"
_SOME = f"{_NODES} WHERE subject IN (SELECT value FROM json_each(?)) ORDER BY id"
_ALL = f"{_NODES} WHERE graph NOT IN (SELECT value FROM json_each(?)) ORDER BY id"


_Row = tuple[int, bytes]  # a node, and what is written of it


class NodeTable(NamedTuple):
    """Nodes in columns of one length, in the order of their numbers."""

    node: Ints
    subject: Ints  # interned
    graph: Ints  # interned


@dataclass(frozen=True, slots=True)
class ReplayedStates:
    """Facts in columns of one length; `value` is a place in `texts` where `kind` is one of text."""

    node: Ints
    predicate: Ints  # interned
    kind: Ints  # as `kg.history.storage.row_codec` has them
    value: Ints
    texts: Sequence[str]

    def facts(self, node: int) -> set[Coded]:
        """The facts about one node, as of `kg.history.replay.subject_replay.facts_at`."""
        some = np.flatnonzero(self.node == node)
        columns = (c[some].tolist() for c in (self.predicate, self.kind, self.value))
        return {
            Coded(predicate, kind, self.texts[value] if kind >= STRING else value)
            for predicate, kind, value in zip(*columns, strict=True)
        }


def foreground(log: HistoryLog, subjects: Iterable[int] | None = None) -> NodeTable:
    """The nodes of all subjects, or of some (interned), but those of ontology and common sense.

    Their past is replayed forwards.
    """
    with log.lock:
        known = (log.terms.find(graph) for graph in BACKGROUND)
        background = [number for number in known if number is not None]
        select, of = (_ALL, background) if subjects is None else (_SOME, [*subjects])
        rows = log.db.execute(select, (json.dumps(of),)).fetchall()
    columns = np.array(rows, np.int64).reshape(-1, 3)
    return NodeTable(*columns[~np.isin(columns[:, 2], background)].T)


def states_at(log: HistoryLog, nodes: Iterable[int], sequence: int) -> ReplayedStates:
    """All facts about the nodes right after the transaction `sequence`."""
    texts = TextColumns()
    parts = [
        _folded(log, some, sequence, texts) for some in _batches([*dict.fromkeys(nodes)], AT_ONCE)
    ]
    columns = np.concatenate([np.zeros((4, 0), np.int64), *parts], axis=1)
    return ReplayedStates(columns[0], columns[1], columns[2], columns[3], texts.all)


def _folded(log: HistoryLog, nodes: Sequence[int], sequence: int, texts: TextColumns) -> Ints:
    """Node, predicate, kind and value of each fact, a row each."""
    states: list[_Row] = []
    after: list[_Row] = []
    before: list[_Row] = []
    for some in _batches(nodes, HELD):
        yield_to_writer()
        with log.lock:
            _read(log, some, sequence, (states, after, before))
    rows = states + after + before  # those of a node in the order in which they count
    owners = np.fromiter((row[0] for row in rows), np.int64, len(rows))
    found = decode_rows([row[1] for row in rows], texts)
    return _final_facts(owners[found.row], _undone(found, len(states) + len(after)))


def _read(
    log: HistoryLog,
    nodes: Sequence[int],
    sequence: int,
    into: tuple[list[_Row], list[_Row], list[_Row]],
) -> None:
    """The full state of each node that is nearest, and the changes between it and `sequence`.

    A state from before the moment is followed by the changes after it; one from after it by those
    that led to it, the last first.
    """
    earlier, later = [], []
    bindings = {"nodes": json.dumps(nodes), "sequence": sequence}
    for node, low, high in log.db.execute(_NEAREST, bindings):
        last = -1 if low is None else low
        if high is None or sequence - last <= high - sequence:
            earlier.append((node, last))
        else:
            later.append((node, high))
    for found, select, near in zip(
        into, (_STATES, _AFTER, _BEFORE), (earlier + later, earlier, later), strict=True
    ):
        found += log.db.execute(select, {"near": json.dumps(near), "sequence": sequence})


def _undone(changes: ChangeColumns, first: int) -> ChangeColumns:
    """The changes with those of the rows from `first` on undone."""
    row, predicate, old_kind, old, new_kind, new = changes
    back = row >= first
    return ChangeColumns(
        row,
        predicate,
        np.where(back, new_kind, old_kind),
        np.where(back, new, old),
        np.where(back, old_kind, new_kind),
        np.where(back, old, new),
    )


def _final_facts(node: Ints, changes: ChangeColumns) -> Ints:
    """Node, predicate, kind and value of each fact that holds in the end, a row each.

    Nearly every predicate has one value at a time. Where each change removes what the one before
    it added, the last change suffices; the others are replayed fact by fact.
    """
    order = np.lexsort((changes.row, changes.predicate, node))
    node, changes = node[order], ChangeColumns(*(column[order] for column in changes))
    first = np.ones(len(node), bool)
    same = (node[1:] == node[:-1]) & (changes.predicate[1:] == changes.predicate[:-1])
    first[1:] = ~same
    group = np.cumsum(first) - 1
    plain = np.ones(int(first.sum()), bool)
    plain[group[~_follows(first, changes)]] = False
    last = np.append(first[1:], True) & plain[group] & (changes.new_kind != NOTHING)
    some = np.flatnonzero(last)
    found = np.array((node, changes.predicate, changes.new_kind, changes.new))[:, some]
    tangled = np.flatnonzero(~plain[group])
    if not len(tangled):
        return found
    more = _replayed(node[tangled], ChangeColumns(*(column[tangled] for column in changes)))
    return np.concatenate((found, more), axis=1)


def _follows(first: NDArray[np.bool_], changes: ChangeColumns) -> NDArray[np.bool_]:
    """Whether each change takes away just what the one before it, of another row, left."""
    row, kind, value = changes.row, changes.old_kind, changes.old
    fits = kind[1:] == changes.new_kind[:-1]
    fits &= (kind[1:] == NOTHING) | (value[1:] == changes.new[:-1])
    fits &= row[1:] != row[:-1]
    follows: NDArray[np.bool_] = kind == NOTHING  # before the first there is nothing
    follows[1:] = np.where(first[1:], follows[1:], fits)
    return follows


def _replayed(node: Ints, changes: ChangeColumns) -> Ints:
    """As `_final_facts`, fact by fact: of each row the removals first, then the additions."""
    holding = dict(_events(node, changes))  # of each fact the last holds
    return np.array([fact for fact, holds in holding.items() if holds], np.int64).reshape(-1, 4).T


def _events(node: Ints, changes: ChangeColumns) -> Iterator[tuple[tuple[int, ...], bool]]:
    sides = (changes.old_kind, changes.old, False), (changes.new_kind, changes.new, True)
    events = [
        (row, holds, fact)
        for kinds, values, holds in sides
        for row, *fact in zip(
            *(column.tolist() for column in (changes.row, node, changes.predicate, kinds, values)),
            strict=True,
        )
        if fact[2] != NOTHING
    ]
    for _, holds, fact in sorted(events, key=lambda event: event[:2]):
        yield tuple(fact), holds


def _batches(nodes: Sequence[int], size: int) -> Iterator[Sequence[int]]:
    return (nodes[start : start + size] for start in range(0, len(nodes), size))
