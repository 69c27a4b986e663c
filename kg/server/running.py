"""A map's server: the application of one map, at an address."""

from __future__ import annotations

from kg.semantic_map import SemanticMap
from kg.server.app import application
from kg.server.feed import Feed
from kg.server.listening import Listening
from kg.server.serving import Serving, Status
from kg.server.settings import Settings
from kg.server.tally import Tally
from kg.workers.pool import QueryPool


class MapServer(Listening):
    """Serves one map; `run` blocks, and as a context manager it serves from a thread.

    The map stays the caller's, to write and to close. Raises ServerError, when made, where the
    address cannot be listened at.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        settings: Settings | None = None,
        *,
        status: Status = dict,
    ) -> None:
        super().__init__(settings)
        limits = self.settings.limits
        self.serving = Serving(
            semantic_map,
            self.settings,
            QueryPool(
                semantic_map,
                workers=limits.workers,
                timeout=limits.query_seconds,
                memory_mb=limits.query_memory,
                max_result_bytes=limits.result,
                services=self.settings.services,
            ),
            Feed(semantic_map, limits),
            Tally(semantic_map),
            status=status,
        )
        self._answer_with(application(self.serving), self.serving.feed.stop)

    def _close(self) -> None:
        self.serving.tally.stop()
        self.serving.pool.close()
        super()._close()
