"""Relocalisation: where a recording lies in a map, by key views that the map keeps.

The views of some of its frames are compared with those of the map (`perception.odometry
.recognition`). The whole recording is then placed by one rigid motion. Its drift stays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError
from mapping.key_views.view_store import StoredView, stored_views, views_damage
from perception.camera.poses import Pose
from perception.frames import Frame
from perception.odometry.features import FeatureDetector
from perception.odometry.recognition import Doubt, Recogniser, Recognition, view_of
from perception.odometry.spread_poses import is_new
from perception.sources.recording import FolderRecording

COMPARED: Final = 80  # views of a recording at most, spread evenly
MAX_VIEWS: Final = 300  # views of a live camera
NO_VIEWS: Final = Doubt("the map keeps no views, as on a server or from older versions")

_WAYS: Final = (
    "a recording that shows what those show, --align (by floor and objects), --transform FILE or a "
    "new map would work"
)


def relocalised(recording: FolderRecording, semantic_map: SemanticMap) -> tuple[Pose, str]:
    """T_map_world (4, 4) of a recording that is new to the map, and a line about it.

    Raises LayoutError where it is not recognised surely.
    """
    found, views = recognised(recording, semantic_map)
    if isinstance(found, Doubt):
        raise _unknown(recording.name, found, semantic_map)
    return found.T @ recording.T_map_world, _summary(found, views)


def recognised_live(
    name: str, frames: Iterable[Frame], semantic_map: SemanticMap
) -> tuple[Pose, str]:
    """T_map_world (4, 4) of the world of live frames, and a line, as soon as that is sure.

    Raises LayoutError where the frames end, or MAX_VIEWS views were compared, before it is sure, or
    where the map keeps no views.
    """
    views = _views(semantic_map)
    detector, recogniser = FeatureDetector(), Recogniser([stored.view for stored in views])
    found: Recognition | Doubt = _no_views(semantic_map)
    for frame in frames if views else ():
        if not is_new(frame.T_map_cam, [view.pose for view in recogniser.images]):
            continue
        if recogniser.look(*view_of(frame, detector)) or isinstance(found, Doubt):
            found = recogniser.result()
        if isinstance(found, Recognition):
            return found.T, _summary(found, views)
        if len(recogniser.images) == MAX_VIEWS:
            break
    assert isinstance(found, Doubt)
    ways = "a camera that shows what those show, or a new map would work"
    raise _unknown(name, found, semantic_map, ways)


def recognised(
    recording: FolderRecording, semantic_map: SemanticMap
) -> tuple[Recognition | Doubt, list[StoredView]]:
    """Place in the map of a recording as it lies now, and the views that the map has."""
    views = _views(semantic_map)
    if not views:
        return _no_views(semantic_map), views
    detector, recogniser = FeatureDetector(), Recogniser([stored.view for stored in views])
    for frame in _apart(recording):
        recogniser.look(*view_of(frame, detector))
    return recogniser.result(), views


def _no_views(semantic_map: SemanticMap) -> Doubt:
    """Why a map has no views to compare with."""
    damage = views_damage(semantic_map.store.path, live=semantic_map.store.live)
    return Doubt(damage) if damage else NO_VIEWS


def _unknown(name: str, found: Doubt, semantic_map: SemanticMap, ways: str = _WAYS) -> LayoutError:
    others = ", ".join(sorted({record.name for record in semantic_map.recordings()}))
    return LayoutError(
        f"the place of {name!r} in this map of {others} is unknown: {found.reason}; {ways}"
    )


def _apart(recording: FolderRecording) -> Iterator[Frame]:
    """Frames of the recording that are apart, spread over it."""
    chosen, poses = list[int](), list[Pose]()
    for number, entry in enumerate(recording.listing.entries):
        if is_new(entry.T_world_cam, poses):
            chosen.append(number)
            poses.append(entry.T_world_cam)
    for index in np.unique(np.linspace(0, len(chosen) - 1, COMPARED).astype(int)):
        yield recording.frame(chosen[index])


def _summary(found: Recognition, views: list[StoredView]) -> str:
    seen = Counter(views[match.view].recording for match in found.matches)
    turn = np.degrees(np.arctan2(found.T[1, 0], found.T[0, 0]))
    x, y, z = found.T[:3, 3]
    return (
        f"recognised in {len(found.matches)} views of {', '.join(sorted(seen))} that agree within "
        f"{found.error:.2f} m: turned by {turn:.1f} degrees, moved by {x:.2f}, {y:.2f}, {z:.2f} m"
    )


def placed_by_views(
    recording: FolderRecording, semantic_map: SemanticMap
) -> tuple[FolderRecording, str]:
    """The recording where `relocalised` finds it, with its line; raises LayoutError."""
    T, line = relocalised(recording, semantic_map)
    return replace(recording.placed(T), transform_given=True), f"{recording.name} was {line}"


def _views(semantic_map: SemanticMap) -> list[StoredView]:
    store = semantic_map.store
    return stored_views(store.path, semantic_map.sequence, live=store.live)
