"""Query subscriptions: a query is evaluated after each commit, its changed rows are reported.

Each subscription has its own thread, so a slow query delays no writer. If it falls behind, its next
evaluation covers several commits.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

from kg.maps.query.evaluation import Row, Table
from kg.model.errors import GraphError, RemoteError
from kg.model.transactions import ChangeSet

POLL_EVERY = 1.0  # [s] where others may commit without a notification

#: Called with the rows added and the rows removed since the last call.
RowsListener = Callable[[Table, Table], None]


class Subscription:
    """A query that is evaluated after each commit until `stop`.

    `answer` evaluates it; `sequence` is the number of the map's last transaction, polled where not
    all commits are notified (`polls`). The rows of the first result are not reported. An exception
    of `callback` ends it.
    """

    def __init__(
        self,
        answer: Callable[[], Table],
        callback: RowsListener,
        sequence: Callable[[], int],
        *,
        polls: bool,
    ) -> None:
        self._answer, self._callback, self._sequence = answer, callback, sequence
        self._every = POLL_EVERY if polls else None
        self._changed, self._stopped = threading.Event(), threading.Event()
        self._last_sequence = sequence()
        self._last = answer()
        self._thread = threading.Thread(target=self._run, name="subscription", daemon=True)
        self._thread.start()

    def on_commit(self, change: ChangeSet) -> None:
        """Have the query evaluated again; returns at once."""
        self._changed.set()

    def check(self) -> None:
        """Have the query evaluated again where the map has changed since the first result."""
        if self._moved():
            self._changed.set()

    def stop(self) -> None:
        """End it; no callback runs once this has returned, unless called from within one."""
        self._stopped.set()
        self._changed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        with suppress(GraphError):  # the map was closed meanwhile
            while not self._stopped.is_set():
                notified = self._changed.wait(self._every)
                self._changed.clear()
                try:
                    if not self._stopped.is_set() and (notified or self._moved()):
                        self._report(self._answer())
                except RemoteError:  # a server may be away, or busy, for a while
                    self._changed.set()
                    self._stopped.wait(POLL_EVERY)

    def _moved(self) -> bool:
        before, self._last_sequence = self._last_sequence, self._sequence()
        return self._last_sequence != before

    def _report(self, now: Table) -> None:
        added, removed = difference(self._last, now)
        self._last = now
        if (added.rows or removed.rows) and not self._stopped.is_set():
            self._callback(added, removed)


def difference(before: Table, now: Table) -> tuple[Table, Table]:
    """Rows of `now` that `before` lacks, and rows of `before` that `now` lacks, in their order."""
    return _less(now, before), _less(before, now)


def _less(table: Table, other: Table) -> Table:
    left = Counter(other.rows)
    rows: list[Row] = []
    for row in table.rows:
        if left[row] > 0:
            left[row] -= 1
        else:
            rows.append(row)
    return Table(table.columns, tuple(rows))
