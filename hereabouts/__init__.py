"""The public names of hereabouts, each imported when it is first used.

    >>> import hereabouts
    >>> with hereabouts.in_memory_map(title="kitchen") as semantic_map:
    ...     print(semantic_map.query("objects").columns[:3])
    ('object', 'label', 'category')

Programs should import these names alone: modules of the packages `kg`, `perception`, `mapping` and
`planner` may change between versions.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # type checkers assume true; `typing` takes longer to import than this module
if TYPE_CHECKING:
    from kg.export.plain_documents import Exporter
    from kg.maps.query.evaluation import Table
    from kg.maps.semantic_map import SemanticMap
    from kg.model.errors import HereaboutsError, MapNotFoundError, RecordingError
    from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
    from kg.model.room_edit import RoomEdit
    from kg.serving.opening import (
        create_map,
        in_memory_map,
        open_map,
        open_or_create_map,
        watch_map,
    )
    from kg.serving.publishing import merged
    from kg.serving.server.app import MapServer
    from kg.serving.server.http.settings import BearerTokens
    from kg.serving.server.http.settings import Settings as ServerSettings
    from mapping.frames.sighting import Sighting
    from mapping.mapper import Mapper
    from mapping.mapping_options import MappingOptions
    from mapping.recording_mapper import map_recording
    from perception.camera.intrinsics import Intrinsics
    from perception.frames import Detections, Frame
    from perception.inference.detector import load_detector
    from perception.sources.listing import Format as RecordingFormat
    from perception.sources.listing import FrameEntry, RecordingListing
    from perception.sources.recording import open_recording
    from perception.sources.recording_options import RecordingOptions
    from planner.questions.answers import answer_question as ask
    from planner.questions.patterns import PlainAnswer
    from planner.search.plans.find import FindAnswer, find
    from planner.search.plans.search_state import build_search
    from planner.search.plans.view_plan import plan as plan_views

    __version__: str

__all__ = [
    "BearerTokens",
    "Detections",
    "Exporter",
    "FindAnswer",
    "Frame",
    "FrameEntry",
    "HereaboutsError",
    "Intrinsics",
    "MapNotFoundError",
    "MapServer",
    "MapUpdate",
    "Mapper",
    "MappingOptions",
    "ObjectRecord",
    "PlaceRecord",
    "PlainAnswer",
    "RecordingError",
    "RecordingFormat",
    "RecordingListing",
    "RecordingOptions",
    "RoomEdit",
    "SemanticMap",
    "ServerSettings",
    "Sighting",
    "Table",
    "__version__",
    "ask",
    "build_search",
    "create_map",
    "find",
    "in_memory_map",
    "load_detector",
    "map_recording",
    "merged",
    "open_map",
    "open_or_create_map",
    "open_recording",
    "plan_views",
    "watch_map",
]

#: module -> its public names; ``inner:public`` where the public name differs
_SOURCES = {
    "kg.serving.opening": "create_map open_map open_or_create_map in_memory_map watch_map",
    "kg.serving.publishing": "merged",
    "kg.maps.semantic_map": "SemanticMap",
    "kg.maps.query.evaluation": "Table",
    "kg.model.records": "MapUpdate ObjectRecord PlaceRecord",
    "kg.model.room_edit": "RoomEdit",
    "kg.serving.server.app": "MapServer",
    "kg.serving.server.http.settings": "Settings:ServerSettings BearerTokens",
    "perception.frames": "Frame Detections",
    "perception.camera.intrinsics": "Intrinsics",
    "perception.sources.listing": "Format:RecordingFormat RecordingListing FrameEntry",
    "kg.export.plain_documents": "Exporter",
    "perception.sources.recording": "open_recording",
    "perception.sources.recording_options": "RecordingOptions",
    "perception.inference.detector": "load_detector",
    "mapping.mapper": "Mapper",
    "mapping.mapping_options": "MappingOptions",
    "mapping.frames.sighting": "Sighting",
    "mapping.recording_mapper": "map_recording",
    "planner.questions.answers": "answer_question:ask",
    "planner.questions.patterns": "PlainAnswer",
    "planner.search.plans.search_state": "build_search",
    "planner.search.plans.find": "FindAnswer find",
    "planner.search.plans.view_plan": "plan:plan_views",
    "kg.model.errors": "HereaboutsError MapNotFoundError RecordingError",
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


if not TYPE_CHECKING:  # so that type checkers report names that do not exist

    def __getattr__(name: str) -> object:
        globals()[name] = value = _load(name)
        return value


def __dir__() -> list[str]:
    return [*__all__]
