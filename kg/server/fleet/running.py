"""A fleet's server: several maps behind one address."""

from __future__ import annotations

from collections.abc import Sequence

from kg.errors import GraphError
from kg.server.fleet.app import fleet_application
from kg.server.fleet.members import Member
from kg.server.fleet.queries import FleetServing
from kg.server.listening import Listening
from kg.server.metrics import Metrics
from kg.server.settings import Settings
from kg.store import MapStore
from kg.workers.pool import QueryPool

GATHERED = 16 << 20  # characters of a query that puts the members' rows in order


class FleetServer(Listening):
    """Serves several maps as one; `run` blocks, and as a context manager it serves from a thread.

    `members` are folders, opened here for reading only, and addresses of SPARQL servers. One that
    is away is tried again whenever it is asked. Raises GraphError where there is none or one is
    there twice, ServerError where the address cannot be listened at.
    """

    def __init__(self, members: Sequence[str], settings: Settings | None = None) -> None:
        if len(set(members)) < len(members) or not members:
            raise GraphError(f"a fleet needs members, each once, got: {', '.join(members)}")
        super().__init__(settings)
        limits = self.settings.limits
        self._nothing = MapStore.in_memory([], read_only=True)
        self.serving = FleetServing(
            tuple(Member(address, limits) for address in members),
            self.settings,
            QueryPool(
                self._nothing,
                workers=limits.workers,
                timeout=limits.query_seconds,
                memory_mb=limits.query_memory,
                max_result_bytes=limits.result,
                max_query_length=GATHERED,
            ),
            Metrics(),
        )
        self._answer_with(fleet_application(self.serving), lambda: None)

    def away(self) -> dict[str, str]:
        """Members that do not open, and why; closes, and raises GraphError, where none does."""
        errors = {m.name: why for m in self.serving.members if (why := m.open())}
        if len(errors) == len(self.serving.members):
            self._close()
            raise GraphError(
                "; ".join(f"no answer from {name}: {why}" for name, why in errors.items())
            )
        return errors

    def _close(self) -> None:
        super()._close()
        for member in self.serving.members:
            member.close()
        self.serving.scribe.close()
        self._nothing.close()
