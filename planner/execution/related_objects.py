"""Related objects: those of the map that something still wanted is usually near."""

from __future__ import annotations

from collections.abc import Sequence

from kg.maps.semantic_map import SemanticMap
from kg.records import ObjectRecord
from planner.goals.targets import Target


class RelatedObjects:
    """Objects related to `targets` by NearBy relations, as of the last question."""

    def __init__(self, semantic_map: SemanticMap, targets: Sequence[Target]) -> None:
        self._map = semantic_map
        self._known = self._query(targets)

    def new_among(
        self, records: Sequence[ObjectRecord], targets: Sequence[Target]
    ) -> list[ObjectRecord]:
        """Those of `records` that are related to `targets` and were not at the last question."""
        if not targets:
            return []
        before, self._known = self._known, self._query(targets)
        return [record for record in records if record.iri in self._known - before]

    def _query(self, targets: Sequence[Target]) -> frozenset[str]:
        return frozenset(
            str(row["iri"])
            for target in targets
            for category in target.queried
            for row in self._map.query("goals-nearby", category=category).records()
        )
