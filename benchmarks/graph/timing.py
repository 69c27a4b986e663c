"""Processor time of operations: medians and tails of repeated runs.

Time of the clock would count what else the machine does. Live runs alone have a clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

BUDGET = 0.5  # [s] a measurement; up to four times that where few runs fit into it
MIN_RUNS, MAX_RUNS = 3, 300  # runs


@dataclass(frozen=True, slots=True)
class Timing:
    """Durations of one operation, in milliseconds."""

    operation: str
    store: str
    objects: int
    median: float
    p95: float
    p99: float
    runs: int
    rows: int | None = None  # of the answer, where it is one

    def to_json(self) -> dict[str, object]:
        """As a JSON object, durations to the microsecond."""
        times = {name: round(getattr(self, name), 3) for name in ("median", "p95", "p99")}
        return {
            "operation": self.operation,
            "store": self.store,
            "objects": self.objects,
            "milliseconds": times,
            "runs": self.runs,
            "rows": self.rows,
        }


def measured(operation: str, store: str, objects: int, run: Callable[[], int | None]) -> Timing:
    """Timing of `run`, which may return how many rows it got; the first run warms up."""
    rows = run()
    durations: list[float] = []
    while goes_on(durations):
        start = time.process_time()
        run()
        durations.append(1000 * (time.process_time() - start))
    return timing(operation, store, objects, durations, rows)


def goes_on(milliseconds: list[float]) -> bool:
    """Whether more runs are worth it after these."""
    runs = len(milliseconds)
    spent = sum(milliseconds) / 1000
    return (
        runs == 0
        or (runs < MIN_RUNS and spent < 4 * BUDGET)
        or (runs < MAX_RUNS and spent < BUDGET)
    )


def timing(
    operation: str, store: str, objects: int, milliseconds: list[float], rows: int | None = None
) -> Timing:
    """Median and tails of durations that were measured elsewhere."""
    median, p95, p99 = (float(p) for p in np.percentile(milliseconds, (50, 95, 99)))
    return Timing(operation, store, objects, median, p95, p99, len(milliseconds), rows)
