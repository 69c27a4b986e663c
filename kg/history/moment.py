"""The map as it was, made only as far as it is asked for: what a query cannot see stays away.

Of a map of a thousand objects with a million observations, folding all that was said takes some
thirty milliseconds; putting everything into a store that answers takes far longer. So the folded
facts stay in columns, and those that match what is asked (`kg.seen`) go into the store, once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NoReturn

import numpy as np
from pyoxigraph import BlankNode, DefaultGraph, NamedNode, Quad, Store

from kg.engine import Engine, Object, Subject
from kg.errors import GraphError
from kg.history.background import background_at
from kg.history.coding import INTERNED, Term
from kg.history.instants import refuse_dropped
from kg.history.log import Log
from kg.history.states import Nodes, States, foreground, states_at
from kg.history.writing import Chosen, Columns, put
from kg.patterns import EVERYTHING, Among, Narrow, Pattern, Seen
from kg.seen import seen_by
from kg.store import MapStore, sequence_quad

SINGLY: Final = 32  # subjects looked up by themselves, until all of their graph are taken in


class Moment:
    """What a map said right after a transaction, as an `Engine` that is only read.

    Reads what it needs from the log, and ontology and common sense from what `engine` gives, which
    says what holds now: both must stay open, and it keeps neither open. Raises HistoryError where
    the moment is dropped meanwhile. Safe from several threads.
    """

    def __init__(self, log: Log, engine: Callable[[], Engine], sequence: int) -> None:
        self.log, self.engine = log, engine
        self.sequence = sequence
        self._store = Store()
        self._made: set[Pattern] = set()
        self._narrow: set[Narrow] = set()
        self._members: dict[frozenset[Among], Chosen] = {}  # of the columns of all subjects
        self._table: tuple[Nodes, States] | None = None  # of all subjects
        self._singly = 0
        self._guard = threading.RLock()

    def __len__(self) -> int:
        """How many facts are made or folded."""
        return len(self._store) + (len(self._table[1].node) if self._table else 0)

    def quads_for_pattern(
        self,
        subject: Subject,
        predicate: NamedNode | None,
        object: Object,
        graph_name: NamedNode | BlankNode | DefaultGraph | None = None,
        /,
    ) -> Iterator[Quad]:
        """The quads that match; None matches anything."""
        terms = (subject, predicate, object, graph_name)
        named = (term if isinstance(term, NamedNode) else None for term in terms)
        self.make(Seen(frozenset((Pattern(*named),))))
        return self._store.quads_for_pattern(*terms)

    def query(
        self,
        query: str,
        /,
        *,
        base_iri: str | None = None,
        prefixes: dict[str, str] | None = None,
        **more: Any,
    ) -> Any:
        """As that of `Engine`; `more` is whatever else pyoxigraph's takes."""
        self.make(seen_by(query, prefixes, base_iri))
        return self._store.query(query, base_iri=base_iri, prefixes=prefixes, **more)

    def update(self, update: str, /) -> NoReturn:
        """Refused: the past is not rewritten."""
        raise GraphError(f"#{self.sequence} is past and cannot be written")

    def __contains__(self, quad: Quad) -> bool:
        return next(self.quads_for_pattern(*quad), None) is not None

    def __iter__(self) -> Iterator[Quad]:
        return iter(self.whole())

    def knows_graph(self, name: NamedNode) -> bool:
        """Whether there ever was such a graph."""
        with self.log.lock:
            number = self.log.terms.find(name)
            select = "SELECT 1 FROM node WHERE graph = ? LIMIT 1"
            return self.log.db.execute(select, (number,)).fetchone() is not None

    def whole(self) -> Store:
        """All of it, in a store."""
        self.make(Seen(frozenset((EVERYTHING,))))
        return self._store

    def make(self, seen: Seen) -> None:
        """Have all that is seen in the store."""
        with self._guard:
            missing = self._missing(seen.whole)
            narrow = {n for n in seen.narrow - self._narrow if not _covered(n.pattern, self._made)}
            if not missing and not narrow:
                return
            patterns = missing | {one.pattern for one in narrow}
            self._store.extend(background_at(self.log, self.engine(), self.sequence, patterns))
            self._take_in(missing, narrow)
            number = sequence_quad(self.sequence)
            if self.sequence and any(pattern.covers(number) for pattern in patterns):
                self._store.add(number)
            refuse_dropped(self.log, self.sequence)
            self._made = {made for made in self._made if not _covered(made, missing)} | missing
            self._narrow |= narrow

    def _missing(self, patterns: Iterable[Pattern]) -> set[Pattern]:
        missing = {pattern for pattern in patterns if not _covered(pattern, self._made)}
        singly = sum(pattern.subject is not None for pattern in missing)
        self._singly += singly
        if singly and self._singly > SINGLY:
            return {p._replace(subject=None, value=None) if p.subject else p for p in missing}
        return missing

    def _take_in(self, missing: set[Pattern], narrow: set[Narrow]) -> None:
        """Put the folded facts into the store that are among those."""
        nodes, states = self._folded(missing, narrow)
        at = np.searchsorted(nodes.node, states.node)
        columns = Columns(
            nodes.subject[at], states.predicate, states.kind, states.value, nodes.graph[at]
        )
        with self.log.lock:
            chosen = np.zeros(len(at), bool)
            for pattern in missing:
                chosen |= self._matching(columns, pattern)
            for one in narrow:
                chosen |= self._matching(columns, one.pattern) & self._subjects(columns, one.among)
            some = Columns(*(column[chosen] for column in columns))
            put(self._store, some, states.texts, self.log.terms)

    def _matching(self, columns: Columns, pattern: Pattern) -> Chosen:
        find = self.log.terms.find
        return columns.matching(*(None if t is None else find(t) or -1 for t in pattern))

    def _subjects(self, columns: Columns, among: frozenset[Among]) -> Chosen:
        """The facts whose subjects are among all of these."""
        if among not in self._members:
            found = np.ones(len(columns.subject), bool)
            for one in among:
                members = self._matching(columns, Pattern(None, one.predicate, None, one.graph))
                members &= columns.kind == INTERNED
                members &= np.isin(columns.value, self._numbers(one))
                found &= np.isin(columns.subject, columns.subject[members])
            self._members[among] = found
        return self._members[among]

    def _numbers(self, among: Among) -> list[int]:
        """The values, interned; those of the background are in the store by now."""
        values: Iterable[Term] = among.values
        if among.above is not None:
            values = {quad.subject for quad in self._store.quads_for_pattern(*among.above)}
        return self.log.terms.numbers(values)

    def _folded(self, missing: set[Pattern], narrow: set[Narrow]) -> tuple[Nodes, States]:
        singly = not narrow and all(pattern.subject is not None for pattern in missing)
        if self._table is None and singly:
            with self.log.lock:
                found = (self.log.terms.find(pattern.subject) for pattern in missing)
                nodes = foreground(self.log, [number for number in found if number is not None])
            return nodes, states_at(self.log, nodes.node.tolist(), self.sequence)
        if self._table is None:
            nodes = foreground(self.log)
            self._table = nodes, states_at(self.log, nodes.node.tolist(), self.sequence)
        return self._table


def _covered(pattern: Pattern, by: Iterable[Pattern]) -> bool:
    return any(other.covers(pattern) for other in by)


class PastStore(MapStore):
    """The store of a map as it was, which is made as far as it is read."""

    def __init__(self, moment: Moment) -> None:
        where = f"#{moment.sequence} of the past"
        super().__init__(moment, where=where, read_only=True, lock=None)
        self._moment = moment

    @property
    def native(self) -> Store:
        """All of it."""
        return self._moment.whole()
