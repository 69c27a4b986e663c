"""Look keeper: embeddings of new pictures by the user's encoder, beside the map.

A thread of the lowest priority describes best views of things and key views while the other threads
wait. The last `_FRESH` pictures wait, since a thing that is seen often has better and better views,
and the others would be for nothing. What is left when the recording ends is described then.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Hashable
from contextlib import suppress

from kg.maps.object_pictures import FOLDER, MAX_VIEW_BYTES, view_picture
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ModelError
from mapping.key_views.view_store import view_poses
from mapping.looks.look_store import ENCODED, Key, LookStore, Rows, described, picture_key
from mapping.looks.user_encoder import UserEncoder, check_same
from mapping.objects.detections.detection_report import BELIEVED
from perception.annotate import VIEW_SIDE, Boxes, Image, object_picture

_NICE = 19  # the lowest priority
_FRESH = 16  # pictures that wait for a better one


class LookKeeper:
    """Keeps embeddings of the pictures of one map.

    Raises ModelError for a map without a folder here, and one that was made with another encoder.
    """

    def __init__(self, semantic_map: SemanticMap, encoder: UserEncoder) -> None:
        folder = semantic_map.store.path
        if folder is None:
            raise ModelError("an encoder needs the folder of a map, and this map has none here")
        check_same(folder, encoder)
        self._map, self._folder, self._encoder = semantic_map, folder, encoder
        self._waiting = dict[Hashable, bytes]()  # pictures by their thing or view
        self._rows: Rows = {}
        self._lock = threading.Lock()
        self._worker: threading.Thread | None = None

    def add(self, name: Hashable, picture: bytes) -> None:
        """Describe the picture of a thing or view in its turn, in place of one that waits still."""
        with self._lock:
            self._waiting.pop(name, None)  # its turn is the last again
            self._waiting[name] = picture
            if self._worker is None and len(self._waiting) > _FRESH:
                self._worker = threading.Thread(target=self._work, name="encoder", daemon=True)
                self._worker.start()

    def add_view(self, key: Key, rgb: Image, people: Boxes) -> None:
        """Keep a picture of a key view, without people, and describe it soon."""
        height, width = rgb.shape[:2]
        whole = (0.0, 0.0, float(width - 1), float(height - 1))
        picture = object_picture(rgb, whole, people, MAX_VIEW_BYTES, side=VIEW_SIDE)
        if picture is None:
            return
        path = view_picture(self._folder, *key)
        with suppress(OSError):  # mapping continues without it
            path.parent.mkdir(exist_ok=True)
            part = path.with_suffix(".part")
            part.write_bytes(picture)
            part.replace(path)
            self.add(key, picture)

    def finish(self) -> None:
        """Describe the rest, and drop what is of pictures that are no more."""
        with self._lock:
            self._waiting.clear()  # each is the picture of a thing or view, or was replaced
            worker = self._worker
        if worker is not None:
            worker.join()
        views = view_poses(self._folder, self._map.sequence, live=True)
        kept = {view_picture(self._folder, *key) for key in views}
        for path in (self._folder / FOLDER).glob("view-*.jpg"):
            if path not in kept:
                path.unlink(missing_ok=True)
        records = (*self._map.objects(min_existence=BELIEVED), *self._map.unnamed_things())
        store = LookStore(self._folder, self._encoder, ENCODED)
        store.settle([record.iri for record in records], views, self._rows)
        self._rows = {}

    def _work(self) -> None:
        with suppress(AttributeError, OSError):  # other systems have no priority of a thread
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        while True:
            with self._lock:
                if len(self._waiting) <= _FRESH:
                    self._worker = None
                    return
                picture = self._waiting.pop(next(iter(self._waiting)))
            self._rows[picture_key(picture)] = described(self._encoder, picture)
