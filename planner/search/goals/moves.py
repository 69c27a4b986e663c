"""Moved objects: objects of the map that stood elsewhere at an earlier moment of its history."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.history.timestamps import Instant
from kg.maps.semantic_map import SemanticMap
from planner.search.goals.status import PRESENT

FAR: Final = 0.3  # [m] from which on an object counts as moved
SURE: Final = 2.0  # standard deviations of the distance that a move must exceed, too


@dataclass(frozen=True, slots=True, eq=False)
class MovedThing:
    """An object that stands elsewhere than at the earlier moment."""

    iri: str
    category: str  # label
    place: str | None  # IRI of the place it is in now
    was: NDArray[np.float64]  # (3,) [m]
    now: NDArray[np.float64]  # (3,) [m]
    deviation: float = 0.0  # [m] standard deviation of each coordinate of their difference

    @property
    def metres(self) -> float:
        """[m] from the earlier spot to the present one."""
        return float(np.linalg.norm(self.now - self.was))


def moved_things(
    semantic_map: SemanticMap, since: Instant, until: Instant | None = None, far: float = FAR
) -> tuple[MovedThing, ...]:
    """Objects that stand at least `far` [m] from where they stood at `since`, the farthest first.

    A move must exceed the uncertainty of both positions, so that a bed seen from another side has
    not moved. Objects that are in only one of the two states are left out. `until` is now by
    default. Raises HistoryError where the history does not reach back to `since`.
    """
    before = {one.iri: one for one in semantic_map.objects(at=since)}
    moved = [
        MovedThing(
            one.iri,
            semantic_map.catalogue.label(one.category),
            one.place,
            before[one.iri].p_map,
            one.p_map,
            math.hypot(before[one.iri].deviation or 0.0, one.deviation or 0.0),
        )
        for one in semantic_map.objects(at=until)
        if one.iri in before and min(one.existence, before[one.iri].existence) >= PRESENT
    ]
    far_enough = [m for m in moved if m.metres >= max(far, SURE * m.deviation)]
    return tuple(sorted(far_enough, key=lambda m: (-m.metres, m.iri)))
