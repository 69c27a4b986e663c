"""Standing questions: asked again whenever the map changes, answered with what is new.

A question runs on a thread of its own, never on the writer's: a slow one falls behind and then sees
several commits at once, but holds nobody up.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

from kg.answers import Row, Table
from kg.commits import ChangeSet
from kg.errors import GraphError, RemoteError

POLL_EVERY = 1.0  # [s] where others may write unheard

#: Hears of the rows that came and of those that went since it last heard.
RowsListener = Callable[[Table, Table], None]


class Standing:
    """A question that stands until `stop`.

    `answer` asks it; `sequence` tells how far the map is, for maps whose commits are not all heard
    (`polls`). The rows there are at the start are not reported. What `callback` raises ends it.
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
        self._heard = sequence()
        self._last = answer()
        self._thread = threading.Thread(target=self._stand, name="standing question", daemon=True)
        self._thread.start()

    def hear(self, change: ChangeSet) -> None:
        """A commit happened; returns at once."""
        self._changed.set()

    def look(self) -> None:
        """Ask once more where the map has moved since the question was first asked."""
        if self._moved():
            self._changed.set()

    def stop(self) -> None:
        """Ask no more; no callback runs once this has returned, unless called from within one."""
        self._stopped.set()
        self._changed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _stand(self) -> None:
        with suppress(GraphError):  # the map was closed meanwhile
            while not self._stopped.is_set():
                told = self._changed.wait(self._every)
                self._changed.clear()
                try:
                    if not self._stopped.is_set() and (told or self._moved()):
                        self._report(self._answer())
                except RemoteError:  # a server may be away, or busy, for a while
                    self._changed.set()
                    self._stopped.wait(POLL_EVERY)

    def _moved(self) -> bool:
        before, self._heard = self._heard, self._sequence()
        return self._heard != before

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
