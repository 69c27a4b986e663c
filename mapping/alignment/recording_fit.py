"""Fit of a recording into a map that holds others: checked by its floor, or found by alignment.

A recording's own world begins where its camera was switched on, so the worlds of two recordings of
one room differ. A given transform is used as it is. Without one the recording's floor must lie on
the map's floor.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError, OntologyError, RecordingError, did_you_mean
from kg.model.regular_files import read_text
from kg.model.shares import percent
from kg.serving.opening import in_memory_map
from mapping.alignment.relocalisation import placed_by_views
from mapping.alignment.search import (
    Alignment,
    AlignmentSearch,
    FloorMatch,
    floor_field,
    floor_of_frames,
    floor_of_map,
)
from mapping.labels.label_resolver import LabelTable
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.occupancy.occupancy_settings import OccupancySettings
from perception.camera.poses import checked_pose
from perception.frames import Detector, Frame, Recording
from perception.sources.recording import FolderRecording


@contextmanager
def temporary_map(semantic_map: SemanticMap) -> Iterator[SemanticMap]:
    """Empty map in memory with the ontology of `semantic_map`.

    It has the shipped ontology if an older map lacks terms of the present vocabulary.
    """
    with in_memory_map() as temporary:
        ontology = semantic_map.ontology.quads()
        if set(ontology) != set(temporary.ontology.quads()):
            with suppress(OntologyError):
                temporary.ontology.replace(ontology, whole=True)
        yield temporary


FITS: Final = 0.9  # minimum `FloorMatch.quality` of a floor in poses that were not aligned
ALIGNED: Final = 0.6  # minimum `FloorMatch.quality` of a floor after alignment
RIVAL: Final = 0.8  # maximum score of the second best alignment, as a share of the best score
CONTRADICTS: Final = 0.0  # `FloorMatch.quality` below which a floor contradicts the given transform
OBJECTS: Final = 5  # matched objects that are enough where the floors hardly overlap
CHECKED: Final = 24  # frames whose floor is compared, spread evenly over the recording
SEARCHED: Final = 80  # frames for an alignment, spread evenly over the recording

_WAYS: Final = (
    "--align searches the transform, --transform FILE gives it, --same-frame says that the poses "
    "are in the map frame"
)
_log = logging.getLogger(__name__)

_OTHERWISE = "--pose X,Y,Z,DEG"


def fitted(
    recording: Recording, semantic_map: SemanticMap, *, same_frame: bool = False
) -> tuple[Recording, str]:
    """Recording with its place in the map, and one line about its fit, or "".

    A recording with estimated poses, which are in a world of its own, is looked for in the map
    (`mapping.alignment.relocalisation`); others are checked as by `check_fit`, and with
    `same_frame` have the floor of the map's others. Raises LayoutError where it is not recognised,
    or does not fit.
    """
    if not isinstance(recording, FolderRecording) or recording.estimate is None:
        if same_frame and isinstance(recording, FolderRecording):
            recording = _on_known_floor(recording, semantic_map)
        return recording, check_fit(recording, semantic_map, same_frame=same_frame)
    known = [record.name for record in semantic_map.recordings() if record.frames_applied]
    if recording.transform_given or not known or recording.name in known:
        return recording, ""
    if same_frame:
        raise LayoutError(
            f"{recording.name!r}: estimated poses are in a world of their own, not in the map "
            "frame; without --same-frame its place is looked for in the map"
        )
    return placed_by_views(recording, semantic_map)


def _on_known_floor(recording: FolderRecording, semantic_map: SemanticMap) -> FolderRecording:
    """The recording on the floor of an earlier one, where only its own estimate differs."""
    for other in semantic_map.recordings() if recording.gravity_aligned else ():
        apart = other.T_map_world @ np.linalg.inv(recording.T_map_world)
        apart[2, 3] = 0.0
        if other.frames_applied and np.allclose(apart, np.eye(4), atol=1e-6):
            return recording.placed(other.T_map_world)
    return recording


def check_fit(recording: Recording, semantic_map: SemanticMap, *, same_frame: bool = False) -> str:
    """Check that a recording new to a map of others fits; returns what was found, one line or "".

    Live recordings have poses in the map frame; with `same_frame` this recording has too. With
    `same_frame` or a given transform, a contradicting floor gives a warning. Otherwise the floor
    must fit.

    Raises:
        LayoutError: neither is given, and the floor does not fit or hardly overlaps.
    """
    others = [r.name for r in semantic_map.recordings() if r.frames_applied]
    if not isinstance(recording, FolderRecording) or not others or recording.name in others:
        return ""
    match = _floor_match(recording, semantic_map)
    is_given = same_frame or recording.transform_given
    if match is not None and match.enough():
        found = f"{percent(match.share)} of its furniture and walls lie on those of the map"
        if match.quality >= FITS:
            return f"{recording.name} fits the map: {found}"
        if is_given and match.quality < CONTRADICTS:
            _log.warning(
                "%s does not fit the map with the given transform: only %s; --align searches one",
                recording.name,
                found,
            )
        problem = f"without a transform its floor does not fit the map: only {found}"
        if match.share > 0.8:
            problem = "without a transform its floor fits the map, but too loosely to be sure"
    else:
        problem = "without a transform its floor hardly overlaps the map's"
    if is_given:
        return ""
    raise LayoutError(
        f"the transform from {recording.name!r} to this map of {', '.join(others)} is unknown; "
        f"{problem}; {_WAYS}"
    )


def aligned(
    recording: FolderRecording,
    semantic_map: SemanticMap,
    detector: Detector,
    *,
    labels: LabelTable | None = None,
) -> tuple[FolderRecording, str]:
    """Align a recording with the map; returns the moved recording, and a line about the fit.

    Where views of it are recognised in those of the map, they place it. Else some of its frames are
    mapped, and their floor and objects are matched with the map's (`mapping.alignment.search`).
    The first recording of a map, and one that is in the map already, are returned unchanged with
    "". Raises LayoutError where no transform fits, or several do.
    """
    known = [record.name for record in semantic_map.recordings() if record.frames_applied]
    if not known or recording.name in known:
        return recording, ""
    with suppress(LayoutError):
        return placed_by_views(recording, semantic_map)
    frames = list(spread(recording, SEARCHED))
    with temporary_map(semantic_map) as temporary:
        with Mapper(
            temporary,
            MappingOptions(labels=labels or LabelTable(), occupancy=False, check_poses=False),
        ) as mapper:
            for frame in frames:
                mapper.add(frame, detector.detect(frame))
        objects = mapper.objects()
    search = AlignmentSearch(
        floor_of_frames(frames),
        floor_of_map(semantic_map.floor()),
        objects,
        semantic_map.objects(),
    )
    found = search.best()
    if found is None:
        raise LayoutError(
            f"{recording.name!r} cannot be aligned: it has neither floor nor objects in common "
            "with the map; --transform FILE would work"
        )
    check_certain(recording.name, found)
    T = found.T @ recording.T_map_world
    return replace(recording.placed(T), transform_given=True), summary_of(recording.name, found)


def check_certain(name: str, found: Alignment, otherwise: str = "--transform FILE") -> None:
    """Raises LayoutError where too little fits, or another place fits as well.

    `otherwise` is the option that works without an alignment.
    """
    by_floor = found.floor.enough() and found.floor.quality >= ALIGNED
    by_objects = found.objects >= OBJECTS and found.floor.quality >= CONTRADICTS
    if not (by_floor or by_objects):
        raise LayoutError(
            f"{name!r} cannot be aligned: the best alignment matches {found.floor.judged} cells of "
            f"floor with quality {found.floor.quality:.2f} (needs {ALIGNED}) and {found.objects} "
            f"objects (needs {OBJECTS}); a larger overlap or {otherwise} would work"
        )
    if found.rival > RIVAL * found.score:
        raise LayoutError(
            f"{name!r} cannot be aligned: the second best alignment scores "
            f"{percent(found.rival / found.score)} of the best (at most {percent(RIVAL)}); a "
            f"larger overlap or {otherwise} would work"
        )


def summary_of(name: str, found: Alignment) -> str:
    """The transform found, and what it lays on what, in one line."""
    x, y, z = found.T[:3, 3]
    turn = np.degrees(np.arctan2(found.T[1, 0], found.T[0, 0]))
    return (
        f"{name} aligned: turned by {turn:.1f} degrees, moved by {x:.2f}, {y:.2f}, {z:.2f} m; "
        f"{percent(found.floor.share)} of its furniture and walls and {found.objects} objects lie "
        f"on those of the map; the second best alignment scores "
        f"{percent(max(found.rival, 0.0) / found.score)} of the best"
    )


def _floor_match(recording: FolderRecording, semantic_map: SemanticMap) -> FloorMatch | None:
    tiles = semantic_map.floor()
    cell = tiles[0].resolution if tiles else OccupancySettings().cell
    field = floor_field(floor_of_map(tiles), cell)
    return None if field is None else field.match(floor_of_frames(spread(recording, CHECKED)))


def spread(recording: FolderRecording, count: int) -> Iterator[Frame]:
    """`count` frames, spread evenly over the recording."""
    for index in np.unique(np.linspace(0, len(recording) - 1, count).astype(int)):
        yield recording.frame(int(index))


def aligned_maps(semantic_map: SemanticMap, other: SemanticMap) -> tuple[NDArray[np.float64], str]:
    """T_other_map (4, 4), and what was found in one line.

    Raises LayoutError where no transform fits, or several do.
    """
    title = semantic_map.description.title
    search = AlignmentSearch(
        floor_of_map(semantic_map.floor()),
        floor_of_map(other.floor()),
        semantic_map.objects(),
        other.objects(),
    )
    found = search.best()
    if found is None:
        raise LayoutError(
            f"{title!r} cannot be aligned: neither floor nor objects are in both maps; "
            f"{_OTHERWISE} would work"
        )
    check_certain(title, found, _OTHERWISE)
    return found.T, summary_of(title, found)


def load_transform(path: Path, sequence: str) -> NDArray[np.float64]:
    """T_map_world (4, 4) of `sequence` from a JSON file {"sequences": {NAME: {"T_map_world": ..}}}.

    Raises LayoutError where there is no such file or sequence, or the matrix is not rigid.
    """
    try:
        data: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise LayoutError(f"cannot read transforms from {path}: {error}") from error
    sequences = data.get("sequences") if isinstance(data, dict) else None
    if not isinstance(sequences, dict):
        raise LayoutError(f'{path} has no "sequences"; {{"sequences": {{NAME: ...}}}} would work')
    entry = sequences.get(sequence)
    if entry is None:
        raise LayoutError(
            f"no sequence {sequence!r} in {path}; there are: {', '.join(sorted(sequences))}"
            + did_you_mean(sequence, sequences)
        )
    matrix = entry.get("T_map_world") if isinstance(entry, dict) else None
    where = f"T_map_world of {sequence!r} in {path}"
    try:
        return checked_pose(np.asarray(matrix, dtype=np.float64), where)
    except RecordingError as error:
        raise LayoutError(str(error)) from None
    except (TypeError, ValueError):
        raise LayoutError(f"{where} is not a matrix of numbers; 4 rows of 4 would work") from None
