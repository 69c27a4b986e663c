"""The map over HTTP: SPARQL Protocol, Graph Store Protocol, linked data, change feed."""

from __future__ import annotations

from kg.maps.semantic_map import SemanticMap
from kg.serving.server.http.bearer_tokens import BearerTokens
from kg.serving.server.http.settings import Limits, Settings
from kg.serving.server.map_server import MapServer

__all__ = ["BearerTokens", "Limits", "MapServer", "Settings", "serve"]


def serve(semantic_map: SemanticMap, settings: Settings | None = None) -> MapServer:
    """A server of `semantic_map`; ``with serve(map) as server:`` answers at ``server.url``.

    The caller may write through `semantic_map` meanwhile. Raises ServerError if it cannot listen at
    the address.
    """
    return MapServer(semantic_map, settings)
