"""Changes of single facts in the history: the transactions that added or removed them."""

from __future__ import annotations

from pyoxigraph import Literal, NamedNode, Quad

from kg.history.storage.log import HistoryLog
from kg.history.storage.log_reader import ChangeLines, Commit, lines_of, quads_of
from kg.rdf.quad_store import Term


class FactChanges:
    """The changes of facts; the history of each subject is read once."""

    def __init__(self, log: HistoryLog) -> None:
        self._log = log
        self._read: dict[Term, list[tuple[int, ChangeLines]]] = {}

    def sequence_of(self, quad: Quad) -> int:
        """The number of the transaction that added `quad`, or else the floor."""
        (line,) = lines_of([quad])
        changes = reversed(self._history(quad.subject))
        sequences = (sequence for sequence, change in changes if line in change.added)
        return next(sequences, self._log.floor)

    def changes_of(
        self,
        subject: NamedNode,
        predicate: str,
        *,
        removed: bool = False,
        value: Term | None = None,
    ) -> list[Commit]:
        """The transactions that added (or `removed`) such a fact, oldest first.

        Without a `value`, facts with any object count.
        """
        start = f"{subject} <{predicate}> ".encode()
        sequences: dict[int, None] = {}
        for sequence, change in self._history(subject):
            lines = change.removed if removed else change.added
            quads = quads_of(line for line in lines if line.startswith(start))
            if any(value is None or same(quad.object, value) for quad in quads):
                sequences[sequence] = None
        commits = map(self._log.commit, sequences)
        return [commit for commit in commits if commit is not None]

    def _history(self, subject: Term) -> list[tuple[int, ChangeLines]]:
        if subject not in self._read:
            self._read[subject] = self._log.whole_history(str(subject).encode())
        return self._read[subject]


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
