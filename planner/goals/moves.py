"""Things that stand elsewhere than at an earlier moment, by the map's history."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.history.timestamps import Instant
from kg.maps.semantic_map import SemanticMap
from planner.goals.status import PRESENT

FAR: Final = 0.3  # [m] from which on a thing counts as moved


@dataclass(frozen=True, slots=True, eq=False)
class MovedThing:
    """An object of both states, in another spot."""

    iri: str
    category: str  # label
    place: str | None  # IRI of the place it is in now
    was: NDArray[np.float64]  # (3,) [m]
    now: NDArray[np.float64]  # (3,) [m]

    @property
    def metres(self) -> float:
        """[m] from the earlier spot to the present one."""
        return float(np.linalg.norm(self.now - self.was))


def moved_things(
    semantic_map: SemanticMap, since: Instant, until: Instant | None = None, far: float = FAR
) -> tuple[MovedThing, ...]:
    """Objects that stand at least `far` [m] from where they stood at `since`, the farthest first.

    `until` is now unless given. What came, or left and was not found elsewhere, is not among
    them. Raises HistoryError for a past that is not kept.
    """
    before = {one.iri: one for one in semantic_map.objects(at=since)}
    moved = [
        MovedThing(
            one.iri,
            semantic_map.catalogue.label(one.category),
            one.place,
            before[one.iri].p_map,
            one.p_map,
        )
        for one in semantic_map.objects(at=until)
        if one.iri in before and min(one.existence, before[one.iri].existence) >= PRESENT
    ]
    return tuple(sorted((m for m in moved if m.metres >= far), key=lambda m: (-m.metres, m.iri)))
