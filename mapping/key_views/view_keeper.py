"""View keeper: keeps a view of each part of the map that a recording's frames show anew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from mapping.key_views.view_store import MAX_VIEWS, Key, StoredView, ViewStore
from perception.camera.poses import Pose
from perception.frames import Frame
from perception.odometry.features import FeatureDetector
from perception.odometry.recognition import MIN_FEATURES, view_of
from perception.odometry.spread_poses import is_new, spare

Boxes = NDArray[np.float32]  # (n, 4) xyxy [px]


class ViewKeeper:
    """Keeps views of the frames of one recording; a map without a folder here keeps none."""

    def __init__(self, semantic_map: SemanticMap, recording: str) -> None:
        path = semantic_map.store.path
        writable = path is not None and not semantic_map.store.read_only
        self._store = ViewStore(path, semantic_map.sequence) if path and writable else None
        self._recording = recording
        self._detector = FeatureDetector()
        held = {} if self._store is None else self._store.poses()
        self._keys: list[Key] = list(held)
        self._poses: list[Pose] = list(held.values())
        self._new: StoredView | None = None  # not in the map yet

    def add(self, frame: Frame, people: Boxes) -> None:
        """Add a frame, for `save` and `accept`, without what is in the boxes of `people`."""
        self._new = None
        T = frame.T_map_cam
        if self._store is None or not is_new(T, self._poses):
            return
        view, _ = view_of(frame, self._detector, without=people)
        if len(view.features) >= MIN_FEATURES:
            self._new = StoredView(self._recording, frame.id, view)

    def save(self, sequence: int) -> None:
        """Store the view beside the map, before its transaction of that number."""
        if self._store is not None and self._new is not None:
            full = len(self._keys) >= MAX_VIEWS and self._new.key not in self._keys
            self._store.write(self._new, sequence, self._keys[spare(self._poses)] if full else None)

    def accept(self) -> None:
        """Count the view, whose transaction is in the map now."""
        if self._new is None:
            return
        if self._new.key in self._keys:
            self._forget(self._keys.index(self._new.key))
        elif len(self._keys) >= MAX_VIEWS:
            self._forget(spare(self._poses))
        self._keys.append(self._new.key)
        self._poses.append(self._new.view.pose)
        self._new = None

    def _forget(self, number: int) -> None:
        del self._keys[number], self._poses[number]
