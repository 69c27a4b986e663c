"""Server of one map."""

from __future__ import annotations

from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import ServerError
from kg.serving.server.app import application
from kg.serving.server.app_state import AppState, Planner, Status
from kg.serving.server.change_broadcast import ChangeBroadcast
from kg.serving.server.http.lifecycle import ServerLifecycle
from kg.serving.server.http.settings import Settings
from kg.serving.server.running_counts import RunningCounts
from kg.serving.workers.isolation.confinement import Confinement
from kg.serving.workers.pool import QueryPool


class MapServer(ServerLifecycle):
    """Serves one map; `run` blocks, a context manager serves from a thread.

    The caller may write the map meanwhile, and closes it. The constructor raises ServerError if it
    cannot listen at the address.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        settings: Settings | None = None,
        *,
        status: Status = dict,
        planner: Planner | None = None,
    ) -> None:
        if not isinstance(semantic_map, StoredMap):
            raise ServerError("the map is served already: use the address of its server")
        super().__init__(settings)
        limits = self.settings.limits
        self.serving = AppState(
            semantic_map,
            self.settings,
            QueryPool(
                semantic_map,
                workers=limits.workers,
                timeout=limits.query_seconds,
                memory_mb=limits.query_memory,
                max_result_bytes=limits.result,
                refresh=limits.staleness,
                services=self.settings.services,
            ),
            ChangeBroadcast(semantic_map, limits),
            RunningCounts(semantic_map),
            status=status,
            planner=planner,
        )
        self._answer_with(application(self.serving), self._end_requests)

    @property
    def confinement(self) -> Confinement:
        """Confinement by the kernel of the processes that evaluate queries."""
        return self.serving.pool.confinement

    def _end_requests(self) -> None:
        """End what would run on: feeds, and writes that are not committed yet."""
        self.serving.feed.stop()
        self.serving.ending.set()

    def _close(self) -> None:
        self.serving.ending.set()
        self.serving.tally.stop()
        self.serving.pool.close()
        super()._close()
