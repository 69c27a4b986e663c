"""The map over HTTP: SPARQL Protocol, Graph Store Protocol, linked data, change feed."""

from __future__ import annotations

from kg.semantic_map import SemanticMap
from kg.server.access import Tokens
from kg.server.fleet.running import FleetServer
from kg.server.running import MapServer
from kg.server.settings import Limits, Settings

__all__ = ["FleetServer", "Limits", "MapServer", "Settings", "Tokens", "serve"]


def serve(semantic_map: SemanticMap, settings: Settings | None = None) -> MapServer:
    """A server of `semantic_map`; ``with serve(map) as server:`` answers at ``server.url``.

    The caller goes on writing through `semantic_map` meanwhile. Raises ServerError where the
    address cannot be listened at, or would be open to others without a token.
    """
    return MapServer(semantic_map, settings)
