"""Viewers that write scenes as messages of topics; and the one that publishes to ROS itself."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, Protocol

import numpy as np

from hereabouts.display.viewers.ros_messages import LIVE_TOPICS, TOPICS, RosMessages, nanoseconds_of
from hereabouts.display.viewers.scene import Scene
from kg.model.records import RobotRecord
from perception.camera.poses import Pose
from perception.frames import Detections, Frame

_log = logging.getLogger(__name__)

_OBJECTS, _MARKERS, _SURFACE = "/hereabouts/objects", "/hereabouts/markers", "/hereabouts/surface"


class TopicViewer(ABC):
    """Viewer of messages; a part of the scene is written as a whole once it has changed."""

    def __init__(self, messages: RosMessages) -> None:
        self._messages = messages
        self._written: dict[str, object] = {}
        self._renewed = threading.Event()

    @abstractmethod
    def _log(self, topic: str, message: object, stamp: float) -> None:
        """Write a message at `stamp` [s since 1970]."""

    def show(self, scene: Scene, stamp: float) -> None:
        """Write the floor, the objects, the markers and the surface if they changed."""
        if self._renewed.is_set():
            self._renewed.clear()
            self._written.clear()
            self._start_again(stamp)
        drawn = replace(scene, robot=None)  # its poses have topics of their own
        for topic, part, make in self._messages.of(drawn, stamp):
            if self._changed(topic, part):
                self._log(topic, make(), stamp)
        self._show_frames(scene, stamp)

    def _show_frames(self, scene: Scene, stamp: float) -> None:
        """Write the frames of tf of objects that were asked for, if they changed."""
        if scene.frames and self._changed("/tf", scene.frames):
            self._log("/tf", self._messages.object_frames(scene, stamp), stamp)

    def _start_again(self, stamp: float) -> None:
        """Called before all is written once more, for a new subscriber."""
        del stamp

    def _changed(self, topic: str, part: object) -> bool:
        """Whether `part` differs from the one written last."""
        before, self._written[topic] = self._written.get(topic), part
        return before != part

    def renew(self) -> None:
        """Let the next `show` write everything, changed or not; from any thread."""
        self._renewed.set()


class TopicPublisher(Protocol):
    """A node of ROS 1 or ROS 2 that publishes topics."""

    def publish(self, topic: str, message: Any) -> None:
        """Send a message of the topic's type; does not wait for subscribers."""

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter of ROS 1's master."""

    def close(self) -> None:
        """Leave. Closing twice is fine."""


#: topic of a scene -> topic that a robot hears: /map belongs to its own localisation
PUBLISHED: Final = {
    topic: "/hereabouts/floor" if topic == "/map" else topic
    for topic in ("/map", _OBJECTS, _MARKERS, _SURFACE)
}
#: the frame of the map in tf, levelled and with its floor at 0, and the number of each category
FRAME: Final = "hereabouts"
CLASSES, INFO = "/hereabouts/categories", "/hereabouts/categories_info"
TF: Final = "/tf_static"
_INFO: Final = "vision_msgs/msg/VisionInfo"


def published_types(*, is_ros1: bool) -> dict[str, str]:
    """Topic -> type of all that `RosViewer` publishes; all are latched."""
    kinds = TOPICS | LIVE_TOPICS
    types = {name: kinds[topic] for topic, name in PUBLISHED.items()}
    types[TF] = "tf2_msgs/msg/TFMessage"
    return types | ({INFO: _INFO} if is_ros1 else {})


class RosViewer(TopicViewer):
    """Viewer that publishes scenes, in the frame "hereabouts", which it places in tf.

    It publishes no robot, and no frames of its camera: the robot has its own.
    """

    def __init__(
        self, publisher: TopicPublisher, frame: str, T_map: Callable[[], Pose], *, is_ros1: bool
    ) -> None:
        """`T_map` gives (4, 4) of the tf frame `frame` ("" for none) to the map's, as it is now."""
        super().__init__(RosMessages(is_ros1=is_ros1, map_frame=FRAME))
        self._publisher, self._frame, self._T_map = publisher, frame, T_map

    def _show_frames(self, scene: Scene, stamp: float) -> None:
        """Publish where the map lies and the frames of objects, all in one latched message."""
        T = self._T_map()
        if not self._changed(TF, (T.tobytes(), scene.frames)):
            return
        made = self._messages.object_frames(scene, stamp)
        if self._frame:
            at = nanoseconds_of(stamp), self._frame, FRAME, np.linalg.inv(T).astype(np.float64)
            made.transforms += self._messages.transforms(*at).transforms
        if made.transforms:
            self._publisher.publish(TF, made)

    def frame(self, frame: Frame, detections: Detections) -> None:
        """Nothing."""

    def robot(self, robot: RobotRecord) -> None:
        """Nothing."""

    def remark(self, text: str, stamp: float) -> None:
        """Warn of what could not be read, once for each text."""
        if self._changed("/rosout", text):
            _log.warning("%s", text)

    def close(self) -> None:
        """Leave."""
        self._publisher.close()

    def _log(self, topic: str, message: object, stamp: float) -> None:
        if (
            topic == _OBJECTS
            and self._messages.is_ros1
            and self._changed(INFO, len(self._messages.classes))
        ):
            self._publisher.set_parameter(CLASSES, list(self._messages.classes))
            header = self._messages.header(nanoseconds_of(stamp), FRAME)
            count = {"database_location": CLASSES, "database_version": len(self._messages.classes)}
            info = self._messages.make(_INFO, header=header, method="hereabouts", **count)
            self._publisher.publish(INFO, info)
        if topic in PUBLISHED:  # a plan has no place here
            self._publisher.publish(PUBLISHED[topic], message)
