"""Outages of a served map while frames are mapped into it live: the mapping goes on after them."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from kg.model.errors import MapBusyError, NotAllowedError, RemoteError, UnreachableError

if TYPE_CHECKING:
    from mapping.recording_mapper import OnDetections
    from perception.frames import Detections, Frame, SceneScores


@dataclass(slots=True)
class MappedFrames:
    """The frames mapped by all runs together."""

    count: int = 0
    by_camera: Counter[str] = field(default_factory=Counter)
    opened: bool = False  # whether the map could be opened once

    def left(self, limit: int | None) -> int | None:
        """Frames that remain of a limit."""
        return None if limit is None else max(limit - self.count, 0)

    def counted(self, on_detections: OnDetections | None) -> OnDetections:
        """A callback for each mapped frame: counts it, then calls `on_detections`."""
        self.opened = True

        def count(frame: Frame, detections: Detections, scene: SceneScores | None) -> None:
            self.count += 1
            self.by_camera[frame.camera] += 1
            if on_detections is not None:
                on_detections(frame, detections, scene)

        return count


def through_outages(
    address: str, ended: threading.Event, mapped: MappedFrames, run: Callable[[], None]
) -> None:
    """Call `run` until it returns; after an outage of the server, call it again.

    All acknowledged frames are in the map; each call of `run` opens the map and continues after
    them.

    Raises:
        HereaboutsError: `run` failed without an outage, or the server refused twice in a row
            without mapping a frame.
        RemoteError: `ended` was set before the server was back.
    """
    from perception.sources.live.connection import Retry

    retry, lost, refused_at = Retry(address, ended), False, -1
    while True:
        before = mapped.count
        try:
            return run()
        except NotAllowedError:
            raise
        except (RemoteError, MapBusyError) as error:
            away = isinstance(error, UnreachableError)
            # after an outage, a late frame of this process may keep the map busy
            known = mapped.opened and (lost or isinstance(error, RemoteError))
            if not known or ended.is_set() or (not away and refused_at == mapped.count):
                raise
            lost, refused_at = True, refused_at if away else mapped.count
            if mapped.count > before:
                retry.worked()
            retry.failed(error)
            if ended.is_set():
                raise
