"""Files that a map keeps beside its facts: which of them cannot be read, and what would help."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.surface_store import FILE as SURFACE
from kg.model.errors import HereaboutsError
from mapping.key_views.view_store import FILE as VIEWS
from mapping.key_views.view_store import views_damage
from mapping.looks.known_things import FILE as KNOWN_THINGS
from mapping.looks.known_things import KnownThings
from mapping.looks.look_store import ENCODED, LOOKS, looks_damage
from mapping.objects.detections.detection_report import FILE as REPORT
from mapping.objects.detections.detection_report import read_report
from mapping.objects.track_store import FILE as TRACKS
from mapping.objects.track_store import tracks_damage
from perception.inference.scene_classifier import FILE as TAUGHT_ROOMS
from perception.inference.scene_classifier import RoomExamples


def unreadable_files(semantic_map: SemanticMap) -> Iterator[tuple[Path, str]]:
    """Each file in the folder of a map that cannot be read, with its damage and a remedy."""
    folder = semantic_map.store.path
    if folder is None:
        return
    for name, damage in {TRACKS: tracks_damage, VIEWS: views_damage}.items():
        if problem := damage(folder, live=semantic_map.store.live):
            yield folder / name, problem
    for name in (LOOKS, ENCODED):
        if problem := looks_damage(folder / name):
            yield folder / name, problem
    readers: dict[str, Callable[[], object]] = {
        REPORT: lambda: read_report(folder),
        KNOWN_THINGS: lambda: KnownThings.load(folder),
        TAUGHT_ROOMS: lambda: RoomExamples.load(folder),
        SURFACE: semantic_map.surface,
    }
    for name, read in readers.items():
        try:
            read()
        except HereaboutsError as error:
            yield folder / name, str(error)
