"""Changes of single facts in the history: the transactions that made or removed them."""

from __future__ import annotations

from pyoxigraph import Literal, NamedNode, Quad

from kg.history.storage.log import Commit, HistoryLog
from kg.history.storage.row_codec import Term, decode_delta


def sequence_of(log: HistoryLog, quad: Quad) -> int:
    """The number of the transaction that made `quad` so; the floor where it is older."""
    with log.lock:
        coded = log.terms.find_code(quad.predicate, quad.object)
        nodes = [
            node
            for node in log.terms.nodes_of(quad.subject)
            if log.terms.pair(node)[0] == quad.graph_name
        ]
    for node in nodes:
        for sequence, data in reversed([*log.history(node)]):
            if coded in decode_delta(data).added:
                return sequence
    return log.floor


def changes_of(
    log: HistoryLog,
    subject: NamedNode,
    predicate: str,
    *,
    removed: bool = False,
    value: Term | None = None,
) -> list[Commit]:
    """The transactions that added (or removed) such a fact of `subject`, oldest first."""
    with log.lock:
        number = log.terms.find(NamedNode(predicate))
        found = [
            sequence
            for node in log.terms.nodes_of(subject)
            for sequence, data in log.history(node)
            for coded in decode_delta(data)[0 if removed else 1]
            if coded.predicate == number and (value is None or same(log.terms.value(coded), value))
        ]
    commits = (log.commit(sequence) for sequence in sorted(set(found)))
    return [commit for commit in commits if commit is not None]


def same(one: Term, other: Term) -> bool:
    """Whether two terms are equal, numbers by their value."""
    if one == other:
        return True
    if not (isinstance(one, Literal) and isinstance(other, Literal)):
        return False
    try:
        return float(one.value) == float(other.value)
    except ValueError:
        return one.value == other.value
