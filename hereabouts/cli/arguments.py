"""Arguments that several commands share, and the conversion of their text to values."""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from kg.model.errors import QueryParameterError

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap

MAP_HELP = "folder of the map, e.g. kitchen.map, or the address of its server"
#: [m] no map is larger than the Earth
MAX_DISTANCE = 1e7
END_WITHIN = 12.0  # [s] after a signal that ends a command
_MIN_SPEED, _MAX_SPEED = 1e-3, 100.0  # [m/s], as in the line protocol
# options whose value may begin with a minus sign, and the pattern of such a value
_SIGNED = ("--from", "--up")
_NEGATIVE = re.compile(r"-(\.?\d.*|[xyz])", re.IGNORECASE)


def title_for(address: str) -> str:
    """The title of a new map at that folder or address."""
    server = urlsplit(address).hostname
    return server or Path(address).stem


def add_map(parser: argparse.ArgumentParser) -> None:
    """The positional MAP."""
    parser.add_argument("map", metavar="MAP", help=MAP_HELP)


def add_keep(parser: argparse.ArgumentParser, otherwise: str) -> None:
    """The `--keep` of commands that write; `keep_seconds` reads it."""
    parser.add_argument(
        "--keep",
        metavar="DURATION",
        help=f"length of the history to keep: 30d, 12h, 90m, 2w or 1y ({otherwise})",
    )


def keep_seconds(arguments: argparse.Namespace) -> float | None:
    """Seconds of `--keep`, None if it is not given; raises HistoryError for no duration."""
    from kg.history.timestamps import duration

    return None if arguments.keep is None else duration(arguments.keep)


def add_json(parser: argparse.ArgumentParser) -> None:
    """The `--json` flag."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def add_author(parser: argparse.ArgumentParser) -> None:
    """The `--by` of commands that write."""
    parser.add_argument("--by", metavar="NAME", help="author (on a server: the token's holder)")


def add_at(parser: argparse.ArgumentParser) -> None:
    """The `--at` of commands that read a past state."""
    parser.add_argument(
        "--at",
        metavar="TIME",
        help="past state to read: a time in ISO 8601, yesterday, 2h (ago), or #42 (transaction)",
    )


def moment_of(text: str) -> str:
    """A moment that a person typed (yesterday, 2h, ISO 8601, #42) as ISO 8601 or #42.

    Raises HistoryError for other texts.
    """
    from kg.history.timestamps import instant

    return instant(text, time.time())


def add_now(parser: argparse.ArgumentParser) -> None:
    """Add the option for the time of a search."""
    parser.add_argument(
        "--now",
        "--at",
        dest="now",
        metavar="TIME",
        help="time of the search: ISO 8601, or 'map': the map's latest time (default: the clock's)",
    )


def now_of(semantic_map: SemanticMap, arguments: argparse.Namespace) -> float:
    """[s since 1970] the time of `--now`."""
    from kg.history.timestamps import moment
    from planner.search.goals.known_objects import map_time

    if arguments.now == "map":
        return map_time(semantic_map)
    return time.time() if arguments.now is None else moment(moment_of(arguments.now))


def add_start(parser: argparse.ArgumentParser) -> None:
    """The `--from` of commands that plan a search."""
    parser.add_argument(
        "--from",
        dest="start",
        type=start_pose,
        metavar="X,Y[,DEG]",
        help="where the search starts [m], and its heading [degrees] (default: the robot's pose)",
    )


def end_on_signal(number: int, frame: object) -> None:
    """Exit and close everything; the default of the signal would not close anything."""
    end_at_latest()
    raise SystemExit(0)


def end_at_latest() -> None:
    """Let the kernel end this process in `END_WITHIN` seconds, whatever its threads do meanwhile.

    A map loses nothing by that: each transaction is in its history before it is acknowledged.
    """
    from kg.model.platforms import end_within

    end_within(END_WITHIN)


def add_device(parser: argparse._ActionsContainer) -> None:
    """The `--device` of commands that run networks."""
    parser.add_argument(
        "--device",
        default="auto",
        metavar="auto|cpu|cuda|...",
        help="device that runs the networks, as onnxruntime names it (default: the fastest)",
    )


def start_pose(text: str) -> tuple[float, float, float]:
    """x, y [m] and heading [rad] of ``X,Y`` or ``X,Y,DEG``; raises ArgumentTypeError."""
    parts = text.split(",")
    try:
        x, y, *facing = (float(part) for part in parts)
    except ValueError:
        facing = [math.nan, math.nan]
    if len(facing) > 1 or not all(math.isfinite(value) for value in facing):
        raise argparse.ArgumentTypeError(f"needs X,Y in metres or X,Y,DEGREES, got {text!r}")
    if not (abs(x) <= MAX_DISTANCE and abs(y) <= MAX_DISTANCE):
        raise argparse.ArgumentTypeError(f"needs X,Y within {MAX_DISTANCE:g} m, got {text!r}")
    return x, y, math.radians(facing[0]) if facing else 0.0


def join_signed(words: Sequence[str]) -> list[str]:
    """``--from -1,2`` as ``--from=-1,2``, since argparse would read the value as an option."""
    joined: list[str] = []
    for word in words:
        if joined and joined[-1] in _SIGNED and _NEGATIVE.fullmatch(word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def positive(text: str) -> float:
    """A finite number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"needs a number above 0, got {text!r}")
    return value


def speed(text: str) -> float:
    """A driving speed [m/s]."""
    value = positive(text)
    if not _MIN_SPEED <= value <= _MAX_SPEED:
        raise argparse.ArgumentTypeError(
            f"needs {_MIN_SPEED:g} to {_MAX_SPEED:g} m/s, got {text!r}"
        )
    return value


def share(text: str) -> float:
    """A number above zero and at most one."""
    value = positive(text)
    if value > 1:
        raise argparse.ArgumentTypeError(f"needs a number above 0 and up to 1, got {text!r}")
    return value


def count(text: str) -> int:
    """A whole number from 0 on."""
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"needs a whole number from 0 on, got {text!r}")
    return int(text)


def whole(text: str) -> int:
    """A whole number from 1 on."""
    if not (text.isascii() and text.isdigit() and int(text)):
        raise argparse.ArgumentTypeError(f"needs a whole number from 1 on, got {text!r}")
    return int(text)


def plain_value(text: str) -> int | float | str:
    """`text` as a number if it is one; parameters of free SPARQL have no declared types."""
    for number in (int, float):
        try:
            value = number(text)
            return value if math.isfinite(value) else text
        except (ValueError, OverflowError):
            continue
    return text


def name_value(pairs: list[str]) -> dict[str, str]:
    """``["a=1", "b=two"]`` as a dictionary; raises QueryParameterError without ``=``."""
    values = {}
    for pair in pairs:
        name, separator, value = pair.partition("=")
        if not separator or not name:
            raise QueryParameterError(f"parameter {pair!r} has no value: write -p name=value")
        values[name] = value
    return values
