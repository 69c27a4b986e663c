"""The public names of hereabouts, each imported when it is first used.

    import hereabouts

    with hereabouts.open_map("kitchen.map", read_only=True) as semantic_map:
        print(semantic_map.query("objects").to_csv())
        search = hereabouts.build_search(semantic_map, ["cup"])

Programs should rely on these names alone. The packages `kg`, `perception`, `mapping` and `planner`
are inner: their modules may change between versions.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # type checkers take it for true; `typing` takes longer than this module
if TYPE_CHECKING:
    from kg.errors import (
        ConflictError,
        ExtensionError,
        GraphError,
        HereaboutsError,
        HistoryError,
        InvalidFactError,
        MapBusyError,
        MapNotFoundError,
        OntologyError,
        QueryError,
        RecordingError,
    )
    from kg.export.exporter import Exporter
    from kg.maps.room_statistics import placement_table
    from kg.maps.semantic_map import SemanticMap
    from kg.ontology.reasoning import load_world, world_quads
    from kg.opening import create_map, in_memory_map, open_map, open_or_create_map
    from kg.publishing.merging import merged
    from kg.query.evaluation import Table
    from kg.records import Assertion, Evidence, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
    from kg.server.http.bearer_tokens import BearerTokens
    from kg.server.http.settings import Settings as ServerSettings
    from kg.server.map_server import MapServer
    from mapping.mapper import Mapper
    from mapping.mapping_options import MappingOptions
    from mapping.recording_mapper import map_recording
    from mapping.sighting import Sighting
    from perception.camera.intrinsics import Intrinsics
    from perception.frames import Detections, Frame, SceneScores
    from perception.inference.detector import load_detector
    from perception.recordings.listing import Format as RecordingFormat
    from perception.recordings.listing import FrameEntry, RecordingListing
    from perception.recordings.recording import open_recording
    from perception.recordings.recording_options import RecordingOptions
    from planner.plans.search_state import build_search
    from planner.plans.view_plan import plan as find

    __version__: str

__all__ = [
    "Assertion",
    "BearerTokens",
    "ConflictError",
    "Detections",
    "Evidence",
    "Exporter",
    "ExtensionError",
    "Frame",
    "FrameEntry",
    "GraphError",
    "HereaboutsError",
    "HistoryError",
    "Intrinsics",
    "InvalidFactError",
    "MapBusyError",
    "MapNotFoundError",
    "MapServer",
    "MapUpdate",
    "Mapper",
    "MappingOptions",
    "ObjectRecord",
    "OntologyError",
    "PlaceRecord",
    "QueryError",
    "RecordingError",
    "RecordingFormat",
    "RecordingListing",
    "RecordingOptions",
    "RobotRecord",
    "SceneScores",
    "SemanticMap",
    "ServerSettings",
    "Sighting",
    "Table",
    "__version__",
    "build_search",
    "create_map",
    "find",
    "in_memory_map",
    "load_detector",
    "load_world",
    "map_recording",
    "merged",
    "open_map",
    "open_or_create_map",
    "open_recording",
    "placement_table",
    "world_quads",
]

#: module -> its public names; ``name:public`` where a name differs here
_SOURCES = {
    "kg.opening": "create_map open_map open_or_create_map in_memory_map",
    "kg.publishing.merging": "merged",
    "kg.maps.semantic_map": "SemanticMap",
    "kg.query.evaluation": "Table",
    "kg.records": "MapUpdate ObjectRecord PlaceRecord RobotRecord Assertion Evidence",
    "kg.maps.room_statistics": "placement_table",
    "kg.ontology.reasoning": "load_world world_quads",
    "kg.server.map_server": "MapServer",
    "kg.server.http.settings": "Settings:ServerSettings",
    "kg.server.http.bearer_tokens": "BearerTokens",
    "perception.frames": "Frame Detections SceneScores",
    "perception.camera.intrinsics": "Intrinsics",
    "perception.recordings.listing": "Format:RecordingFormat RecordingListing FrameEntry",
    "kg.export.exporter": "Exporter",
    "perception.recordings.recording": "open_recording",
    "perception.recordings.recording_options": "RecordingOptions",
    "perception.inference.detector": "load_detector",
    "mapping.mapper": "Mapper",
    "mapping.mapping_options": "MappingOptions",
    "mapping.sighting": "Sighting",
    "mapping.recording_mapper": "map_recording",
    "planner.plans.search_state": "build_search",
    "planner.plans.view_plan": "plan:find",
    "kg.errors": (
        "HereaboutsError GraphError MapNotFoundError MapBusyError HistoryError ConflictError "
        "InvalidFactError QueryError OntologyError RecordingError ExtensionError"
    ),
}


def _load(name: str) -> object:
    """Import a public name at its first use (PEP 562)."""
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version(__name__)
    for module, names in _SOURCES.items():
        for inner, _, public in (each.partition(":") for each in names.split()):
            if name == (public or inner):
                return getattr(importlib.import_module(module), inner)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


if not TYPE_CHECKING:  # a type checker knows the names above, and reports any other

    def __getattr__(name: str) -> object:
        globals()[name] = value = _load(name)
        return value


def __dir__() -> list[str]:
    return [*__all__]
