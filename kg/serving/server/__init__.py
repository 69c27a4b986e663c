"""The map over HTTP: SPARQL Protocol, Graph Store Protocol, linked data, change feed."""

from kg.serving.server.app import MapServer
from kg.serving.server.http.settings import BearerTokens, Limits, Settings

__all__ = ["BearerTokens", "Limits", "MapServer", "Settings"]
