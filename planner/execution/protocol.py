"""Robot protocol: JSON objects, one a line (docs/reference/robot-protocol.md).

This module checks every number that a robot sends. All other modules can rely on finite metres and
radians in the map frame, and on texts without control characters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from kg.model.areas import MAX_COORDINATE
from perception.frames import Detections, Frame

VERSION: Final = 1
MAX_LINE: Final = 1 << 20  # [bytes]
MAX_OBJECTS: Final = 1000  # detections in one message
_MAX_TEXT = 300
_MAX_PIXEL: Final = 1e6  # [px] coordinate in an image


class MalformedValueError(ValueError):
    """A message does not follow the protocol. This error stays within the package."""


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message in both directions; a robot may describe itself, None means unknown."""

    protocol: int = VERSION
    name: str = "hereabouts"
    speed: float | None = None  # [m/s]
    turn_rate: float | None = None  # [rad/s]
    near: float | None = None  # [m] the camera detects from here ...
    far: float | None = None  # [m] ... to there
    field_of_view: float | None = None  # [rad] across
    recall: float | None = None  # chance to detect an object in view, 0..1
    detector: str | None = None  # name of the detector


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive to (x, y) and turn to `heading`; answer `arrived`, `blocked` or `error`, same id."""

    id: int
    x: float  # [m]
    y: float
    heading: float  # [rad]


@dataclass(frozen=True, slots=True)
class LookAround:
    """Turn by `turn` [rad, to the left] and take pictures; answer `detections`, same id.

    `extent` [rad] is the angle in view altogether: the turn and the camera's field of view.
    """

    id: int
    turn: float
    extent: float


@dataclass(frozen=True, slots=True)
class StopCommand:
    """Stand still; the current command gets no answer."""


Command = Hello | GoTo | LookAround | StopCommand


@dataclass(frozen=True, slots=True)
class RobotPose:
    """Pose of the robot; sent repeatedly while it drives."""

    x: float  # [m]
    y: float
    heading: float  # [rad]
    seconds: float | None = None  # [s] by the robot's own clock


@dataclass(frozen=True, slots=True)
class Arrived:
    """The `goto` with that id is done."""

    id: int


@dataclass(frozen=True, slots=True)
class Blocked:
    """The `goto` with that id failed because of an obstacle at (x, y)."""

    id: int | None
    x: float  # [m]
    y: float
    reason: str


@dataclass(frozen=True, slots=True)
class Detected:
    """One detection."""

    label: str
    score: float  # 0..1
    x: float  # [m]
    y: float
    z: float
    frame: str = ""  # id of the picture
    box: tuple[float, float, float, float] | None = None  # xyxy [px] in it
    depth: float | None = None  # [m] along the optical axis; "range" on the wire


@dataclass(frozen=True, slots=True)
class DetectedFrame:
    """A picture with depth and pose, and its detections; it is never sent over a connection."""

    frame: Frame
    detections: Detections


@dataclass(frozen=True, slots=True)
class DetectionsMessage:
    """Detections of one picture on the way (no id), or of all pictures of the `look` with that id.

    They are positions; a robot in this process may send `views` instead. `pose` is the robot's pose
    at the picture; by default its last pose.
    """

    id: int | None
    objects: tuple[Detected, ...] = ()
    pose: RobotPose | None = None
    views: tuple[DetectedFrame, ...] = ()


@dataclass(frozen=True, slots=True)
class OnTheWay:
    """Progress of navigation on its way to a goal; only a robot in this process sends it."""

    distance: float  # [m] that is left
    seconds: float  # [s] that it takes, as navigation estimates them
    recoveries: int  # so far: turns, waits or steps back to get free


@dataclass(frozen=True, slots=True)
class Failed:
    """The command with that id failed, for a reason other than an obstacle."""

    id: int | None
    reason: str


@dataclass(frozen=True, slots=True)
class Aborted:
    """The robot ends the search, because its battery is low for example."""

    reason: str


@dataclass(frozen=True, slots=True)
class MalformedMessage:
    """Data from a robot that is no message of the protocol."""

    why: str


Message = (
    Hello
    | RobotPose
    | OnTheWay
    | Arrived
    | Blocked
    | DetectionsMessage
    | Failed
    | Aborted
    | MalformedMessage
)

_NAMES: Final[dict[type, str]] = {
    GoTo: "goto",
    LookAround: "look",
    StopCommand: "stop",
    Hello: "hello",
}


def encoded(command: Command) -> dict[str, Any]:
    """A command as the JSON object that goes over the wire."""
    fields = {k: _rounded(v) for k, v in asdict(command).items() if v is not None}
    return {"type": _NAMES[type(command)], **fields}


def line_of(command: Command) -> bytes:
    """A command as a line of the protocol, newline included."""
    return json.dumps(encoded(command), separators=(",", ":")).encode() + b"\n"


def decoded(line: bytes | str) -> Message | None:
    """The message in a line; None for a type that this version does not know.

    Raises MalformedValueError for a line that is no message.
    """
    try:
        value = json.loads(line if isinstance(line, str) else line.decode())
    except (ValueError, RecursionError) as error:
        raise MalformedValueError(f"not JSON: {error}") from None
    return message_of(value)


def message_of(value: object) -> Message | None:
    """As `decoded`, from parsed JSON."""
    if not isinstance(value, dict) or not isinstance(value.get("type"), str):
        raise MalformedValueError("needs a JSON object with a type")
    reader = _READERS.get(value["type"])
    return reader(value) if reader else None


def cleaned(text: object) -> str:
    """A text from outside as one line without control characters, at most 300 long."""
    kept = "".join(c if c.isprintable() else " " for c in str(text)[: 4 * _MAX_TEXT])
    return " ".join(kept.split())[:_MAX_TEXT]


def _rounded(value: object) -> object:
    return round(value, 4) + 0.0 if isinstance(value, float) else value


def _hello(fields: Mapping[str, Any]) -> Hello:
    protocol = fields.get("protocol")
    if not isinstance(protocol, int) or isinstance(protocol, bool):
        raise MalformedValueError("hello needs a whole number as protocol")
    return Hello(
        protocol=protocol,
        name=cleaned(fields.get("name", "robot")) or "robot",
        speed=_optional(fields, "speed", 1e-3, 100.0),
        turn_rate=_optional(fields, "turn_rate", 1e-3, 100.0),
        near=_optional(fields, "near", 0.0, 1000.0),
        far=_optional(fields, "far", 0.1, 1000.0),
        field_of_view=_optional(fields, "field_of_view", 0.01, 2 * math.pi + 1e-6),
        recall=_optional(fields, "recall", 0.01, 1.0),
        detector=cleaned(fields.get("detector") or "") or None,
    )


def _pose(fields: Mapping[str, Any]) -> RobotPose:
    heading = _number(fields, "heading", -1e6, 1e6)
    return RobotPose(
        x=_metres(fields, "x"),
        y=_metres(fields, "y"),
        heading=(heading + math.pi) % (2 * math.pi) - math.pi,
        seconds=_optional(fields, "t", -1e12, 1e12),
    )


def _arrived(fields: Mapping[str, Any]) -> Arrived:
    number = _id(fields)
    if number is None:
        raise MalformedValueError("arrived needs the id of its goto")
    return Arrived(number)


def _blocked(fields: Mapping[str, Any]) -> Blocked:
    reason = cleaned(fields.get("reason", "")) or "blocked"
    return Blocked(_id(fields), _metres(fields, "x"), _metres(fields, "y"), reason)


def _detections(fields: Mapping[str, Any]) -> DetectionsMessage:
    objects = fields.get("objects", [])
    if not isinstance(objects, list) or len(objects) > MAX_OBJECTS:
        raise MalformedValueError(f"detections need a list of at most {MAX_OBJECTS} objects")
    pose = fields.get("pose")
    if pose is not None and not isinstance(pose, dict):
        raise MalformedValueError("the pose of detections must be an object")
    return DetectionsMessage(
        id=_id(fields),
        objects=tuple(_detected(thing) for thing in objects),
        pose=None if pose is None else _pose(pose),
    )


def _detected(thing: object) -> Detected:
    if not isinstance(thing, dict) or not isinstance(thing.get("label"), str):
        raise MalformedValueError("a detection needs a label")
    frame, box = cleaned(thing.get("frame") or ""), thing.get("box")
    if box is not None and not frame:
        raise MalformedValueError("a box needs the frame that it is in")
    return Detected(
        label=cleaned(thing["label"]),
        score=_number(thing, "score", 0.0, 1.0),
        x=_metres(thing, "x"),
        y=_metres(thing, "y"),
        z=_metres(thing, "z") if "z" in thing else 0.0,
        frame=frame,
        box=None if box is None else _box(box),
        depth=_optional(thing, "range", 0.0, 1000.0),
    )


def _box(corners: object) -> tuple[float, float, float, float]:
    if not isinstance(corners, list) or len(corners) != 4:
        raise MalformedValueError("a box must be [x1, y1, x2, y2]")
    named = dict(zip(("x1", "y1", "x2", "y2"), corners, strict=True))
    x1, y1, x2, y2 = (_number(named, key, -_MAX_PIXEL, _MAX_PIXEL) for key in named)
    if not (x1 < x2 and y1 < y2):
        raise MalformedValueError("a box must have x1 < x2 and y1 < y2")
    return x1, y1, x2, y2


def _reason(fields: Mapping[str, Any]) -> str:
    return cleaned(fields.get("reason", "")) or "no reason given"


_READERS: Final[dict[str, Callable[[Mapping[str, Any]], Message]]] = {
    "hello": _hello,
    "pose": _pose,
    "arrived": _arrived,
    "blocked": _blocked,
    "detections": _detections,
    "error": lambda fields: Failed(_id(fields), _reason(fields)),
    "abort": lambda fields: Aborted(_reason(fields)),
}


def _id(fields: Mapping[str, Any]) -> int | None:
    number = fields.get("id")
    if number is None:
        return None
    if not isinstance(number, int) or isinstance(number, bool):
        raise MalformedValueError("an id must be a whole number")
    return number


def _metres(fields: Mapping[str, Any], key: str) -> float:
    return _number(fields, key, -MAX_COORDINATE, MAX_COORDINATE)


def _optional(fields: Mapping[str, Any], key: str, low: float, high: float) -> float | None:
    return None if fields.get(key) is None else _number(fields, key, low, high)


def _number(fields: Mapping[str, Any], key: str, low: float, high: float) -> float:
    value = fields.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedValueError(f"{key} must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not low <= number <= high:  # also raises for nan
        raise MalformedValueError(f"{key} must lie in {low:g}..{high:g}")
    return number
