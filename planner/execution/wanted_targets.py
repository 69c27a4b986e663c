"""Wanted targets: which targets of a search are found, and where."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from kg.model.records import ObjectRecord
from planner.search.goals.targets import Target


class WantedTargets:
    """The targets of one search, and the positions of those that were found."""

    def __init__(self, targets: Sequence[Target]) -> None:
        self._targets = tuple(targets)
        self._found: dict[str, NDArray[np.float64]] = {}

    @property
    def all(self) -> tuple[Target, ...]:
        """All targets, found or not."""
        return self._targets

    @property
    def wanted(self) -> tuple[Target, ...]:
        """The targets that are not found yet."""
        return tuple(t for t in self._targets if t.text not in self._found)

    @property
    def found(self) -> tuple[tuple[str, NDArray[np.float64]], ...]:
        """Text and position (3,) [m] of each target that is found; an agent's is (2,)."""
        return tuple(self._found.items())

    def is_found(self, target: Target) -> bool:
        """Whether a target is found."""
        return target.text in self._found

    def add_found(self, text: str, p_map: NDArray[np.float64]) -> None:
        """Count the target `text` as found at `p_map`."""
        self._found[text] = p_map

    def restore(self, records: Iterable[ObjectRecord]) -> None:
        """Count the targets as found that objects found by earlier runs are of."""
        for record in records:
            for target in self._targets:
                if target.accepts(record.category, record.iri):
                    self._found.setdefault(target.text, record.p_map)
