"""What a robot and a search say to each other: JSON objects, a line each (docs/ros.md).

Every number that a robot sends is checked here, once; what lies behind sees finite metres and
radians in the map frame, and texts without control characters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

VERSION: Final = 1
LONGEST_LINE: Final = 1 << 20  # [bytes]
FARTHEST: Final = 1e7  # [m] no map is larger than the Earth
MOST_OBJECTS: Final = 1000  # detections in one message
_LONGEST_TEXT = 300


class MalformedError(ValueError):
    """A message that is not one of the protocol; never leaves this package."""


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message, both ways. A robot may say what it can; None is not known."""

    protocol: int = VERSION
    name: str = "hereabouts"
    speed: float | None = None  # [m/s]
    turn_rate: float | None = None  # [rad/s]
    near: float | None = None  # [m] the camera detects from here ...
    far: float | None = None  # [m] ... to there
    field_of_view: float | None = None  # [rad] across
    recall: float | None = None  # chance to detect what a picture shows, 0..1


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive there, turn to `heading`, answer `arrived`, `blocked` or `error` with the same id."""

    id: int
    x: float  # [m]
    y: float
    heading: float  # [rad]


@dataclass(frozen=True, slots=True)
class LookAround:
    """Turn by `turn` [rad, to the left] with pictures all the way; answer `detections`, same id.

    `extent` [rad] is what is then seen in all: the turn and the camera's own field of view.
    """

    id: int
    turn: float
    extent: float


@dataclass(frozen=True, slots=True)
class Stop:
    """Stand still; the command under way will not be waited for."""


Command = Hello | GoTo | LookAround | Stop


@dataclass(frozen=True, slots=True)
class RobotPose:
    """Where the robot is; sent as often as it likes while it drives."""

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
    """The `goto` with that id cannot be done: something is in the way at (x, y)."""

    id: int | None
    x: float  # [m]
    y: float
    reason: str


@dataclass(frozen=True, slots=True)
class Detected:
    """One thing that a detector saw."""

    label: str
    score: float  # 0..1
    x: float  # [m]
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Detections:
    """What one picture on the way shows (no id), or all pictures of the `look` with that id.

    `pose` is where the picture was taken; None: at the last pose.
    """

    id: int | None
    objects: tuple[Detected, ...]
    pose: RobotPose | None = None


@dataclass(frozen=True, slots=True)
class Failed:
    """The command with that id failed, for a reason that is not a thing in the way."""

    id: int | None
    reason: str


@dataclass(frozen=True, slots=True)
class Aborted:
    """The robot ends the search: battery low, somebody took over."""

    reason: str


@dataclass(frozen=True, slots=True)
class Nonsense:
    """Stands for something a robot said that is no message of the protocol."""

    why: str


Message = Hello | RobotPose | Arrived | Blocked | Detections | Failed | Aborted | Nonsense

_NAMES: Final[dict[type, str]] = {GoTo: "goto", LookAround: "look", Stop: "stop", Hello: "hello"}


def encoded(command: Command) -> dict[str, Any]:
    """A command as the JSON object that goes over the wire."""
    said = {k: _rounded(v) for k, v in asdict(command).items() if v is not None}
    return {"type": _NAMES[type(command)], **said}


def line_of(command: Command) -> bytes:
    """A command as a line of the protocol, newline included."""
    return json.dumps(encoded(command), separators=(",", ":")).encode() + b"\n"


def decoded(line: bytes | str) -> Message | None:
    """The message in a line; None for a kind that this version does not know.

    Raises MalformedError for anything that is no message.
    """
    try:
        value = json.loads(line if isinstance(line, str) else line.decode())
    except (ValueError, RecursionError) as error:
        raise MalformedError(f"not JSON: {error}") from None
    return message_of(value)


def message_of(value: object) -> Message | None:
    """As `decoded`, of JSON that is parsed already."""
    if not isinstance(value, dict) or not isinstance(value.get("type"), str):
        raise MalformedError("needs a JSON object with a type")
    reader = _READERS.get(value["type"])
    return reader(value) if reader else None


def cleaned(text: object) -> str:
    """Somebody else's text as one line without control characters, at most 300 long."""
    kept = "".join(c if c.isprintable() else " " for c in str(text)[: 4 * _LONGEST_TEXT])
    return " ".join(kept.split())[:_LONGEST_TEXT]


def _rounded(value: object) -> object:
    return round(value, 4) + 0.0 if isinstance(value, float) else value


def _hello(said: Mapping[str, Any]) -> Hello:
    protocol = said.get("protocol")
    if not isinstance(protocol, int) or isinstance(protocol, bool):
        raise MalformedError("hello needs a whole number as protocol")
    return Hello(
        protocol=protocol,
        name=cleaned(said.get("name", "robot")) or "robot",
        speed=_optional(said, "speed", 1e-3, 100.0),
        turn_rate=_optional(said, "turn_rate", 1e-3, 100.0),
        near=_optional(said, "near", 0.0, 1000.0),
        far=_optional(said, "far", 0.1, 1000.0),
        field_of_view=_optional(said, "field_of_view", 0.01, 2 * math.pi + 1e-6),
        recall=_optional(said, "recall", 0.01, 1.0),
    )


def _pose(said: Mapping[str, Any]) -> RobotPose:
    heading = _number(said, "heading", -1e6, 1e6)
    return RobotPose(
        x=_metres(said, "x"),
        y=_metres(said, "y"),
        heading=(heading + math.pi) % (2 * math.pi) - math.pi,
        seconds=_optional(said, "t", -1e12, 1e12),
    )


def _arrived(said: Mapping[str, Any]) -> Arrived:
    number = _id(said)
    if number is None:
        raise MalformedError("arrived needs the id of its goto")
    return Arrived(number)


def _blocked(said: Mapping[str, Any]) -> Blocked:
    reason = cleaned(said.get("reason", "")) or "blocked"
    return Blocked(_id(said), _metres(said, "x"), _metres(said, "y"), reason)


def _detections(said: Mapping[str, Any]) -> Detections:
    objects = said.get("objects", [])
    if not isinstance(objects, list) or len(objects) > MOST_OBJECTS:
        raise MalformedError(f"detections need a list of at most {MOST_OBJECTS} objects")
    pose = said.get("pose")
    if pose is not None and not isinstance(pose, dict):
        raise MalformedError("the pose of detections must be an object")
    return Detections(
        id=_id(said),
        objects=tuple(_detected(thing) for thing in objects),
        pose=None if pose is None else _pose(pose),
    )


def _detected(thing: object) -> Detected:
    if not isinstance(thing, dict) or not isinstance(thing.get("label"), str):
        raise MalformedError("a detection needs a label")
    return Detected(
        label=cleaned(thing["label"]),
        score=_number(thing, "score", 0.0, 1.0),
        x=_metres(thing, "x"),
        y=_metres(thing, "y"),
        z=_metres(thing, "z") if "z" in thing else 0.0,
    )


def _failed(said: Mapping[str, Any]) -> Failed:
    return Failed(_id(said), cleaned(said.get("reason", "")) or "no reason given")


def _aborted(said: Mapping[str, Any]) -> Aborted:
    return Aborted(cleaned(said.get("reason", "")) or "no reason given")


_READERS: Final[dict[str, Callable[[Mapping[str, Any]], Message]]] = {
    "hello": _hello,
    "pose": _pose,
    "arrived": _arrived,
    "blocked": _blocked,
    "detections": _detections,
    "error": _failed,
    "abort": _aborted,
}


def _id(said: Mapping[str, Any]) -> int | None:
    number = said.get("id")
    if number is None:
        return None
    if not isinstance(number, int) or isinstance(number, bool):
        raise MalformedError("an id must be a whole number")
    return number


def _metres(said: Mapping[str, Any], key: str) -> float:
    return _number(said, key, -FARTHEST, FARTHEST)


def _optional(said: Mapping[str, Any], key: str, least: float, most: float) -> float | None:
    return None if said.get(key) is None else _number(said, key, least, most)


def _number(said: Mapping[str, Any], key: str, least: float, most: float) -> float:
    value = said.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedError(f"{key} must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not least <= number <= most:  # not a number is refused here too
        raise MalformedError(f"{key} must lie in {least:g}..{most:g}")
    return number
