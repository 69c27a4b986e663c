"""Journal of a store: the interface of its write-ahead log."""

from __future__ import annotations

from typing import Protocol

from kg.model.transactions import ChangeSet


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
