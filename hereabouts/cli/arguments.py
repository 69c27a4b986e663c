"""Arguments that several commands share, and the conversion of their text to values."""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from hereabouts.cli.console import note
from kg.model.errors import QueryParameterError

if TYPE_CHECKING:
    from hereabouts.display.viewers.viewer import Viewer
    from kg.maps.semantic_map import SemanticMap


Options = TypeVar("Options")

MAP_HELP = "folder of the map, e.g. kitchen.map, or the address of its server"
#: arguments that several commands have, which name them alone
_SHARED = f"""
MAP                         {MAP_HELP}
--json                      print JSON instead of a table
--by NAME                   author (on a server: the token's holder)
--at TIME                   past state to read: a time in ISO 8601, yesterday, 2h (ago), or #42
                            (transaction)
--now, --at TIME            time of the search: ISO 8601, or 'map': the map's latest time (default:
                            the clock's)
--from X,Y[,DEG] -> start   where the search starts [m], and its heading [degrees] (default: the
                            robot's pose)
--labels-map FILE  CSV file with lines label,category; the category - ignores the label
--device auto|cpu|cuda|...  device that runs the networks, as onnxruntime names it (default: the
                            fastest)
"""
#: [m] no map is larger than the Earth
MAX_DISTANCE = 1e7
END_WITHIN = 12.0  # [s] after a signal that ends a command
_MIN_SPEED, _MAX_SPEED = 1e-3, 100.0  # [m/s], as in the line protocol
# options whose value may begin with a minus sign, and the pattern of such a value
_SIGNED = ("--from", "--up")
_NEGATIVE = re.compile(r"-(\.?\d.*|[xyz])", re.IGNORECASE)


def declare(parser: argparse._ActionsContainer, text: str, **how: Any) -> None:
    """Declare the arguments in `text`, written as `--help` shows them, each with what it means.

    ``OBJECT``, ``[OBJECT]``, ``OBJECT ...`` and ``[OBJECT ...]`` are one, at most one, one or more
    and any number of words; ``--file FILE ...`` may be repeated, and an option without a value is a
    flag. ``-> name`` is the attribute that gets the value, by default that of the option. `how`
    gives an attribute its type, or argparse's keywords.
    """
    shared = {spec.split()[0].rstrip(","): (spec, meaning) for spec, meaning in _entries(_SHARED)}
    how = {"start": start_pose, "device": {"default": "auto"}, **how}
    for spec, meaning in _entries(text):
        if not meaning:
            spec, meaning = shared[spec]
        spec, _, attribute = spec.partition(" -> ")
        names = [word.rstrip(",") for word in spec.split() if word.startswith("-")]
        value = " ".join(spec.split()[len(names) :])
        if optional := value.startswith("[") and value.endswith("]"):
            value = value[1:-1]
        repeated, metavar = value.endswith(" ..."), value.removesuffix(" ...")
        long = next((name for name in names if name.startswith("--")), metavar.lower())
        attribute = attribute or long.lstrip("-").replace("-", "_")
        if names == ["--json"] and attribute == "format":
            parser.add_argument(
                "--json", action="store_const", const="json", dest="format", help=meaning
            )
            continue
        given = how.get(attribute, {})
        keywords = given if isinstance(given, dict) else {"type": given}
        if metavar:
            keywords = {"metavar": metavar, **keywords}
        if optional:
            keywords = {"nargs": "*" if repeated else "?", **keywords}
        elif repeated:
            many = {"action": "append", "default": []} if names else {"nargs": "+"}
            keywords = {**many, **keywords}
        if not names:
            parser.add_argument(attribute, help=meaning, **keywords)
        else:
            keywords = keywords or {"action": "store_true"}
            parser.add_argument(*names, dest=attribute, help=meaning, **keywords)


def options_of(kind: type[Options], arguments: argparse.Namespace, **others: Any) -> Options:
    """The dataclass `kind` of the arguments that have its fields' names, and of `others`."""
    given = vars(arguments)
    named = (field.name for field in fields(kind))  # type: ignore[arg-type]
    return kind(**{name: given[name] for name in named if name in given} | others)


def _entries(text: str) -> Iterator[tuple[str, str]]:
    """Each argument of a text and its meaning; an indented line continues the one before."""
    for entry in re.split(r"\n(?=\S)", text.strip()):
        spec, *meaning = re.split(r" {2,}|\n", entry, maxsplit=1)
        yield spec, " ".join(" ".join(meaning).split())


def add_command(
    commands: argparse._SubParsersAction[Any], name: str, text: str, **defaults: object
) -> argparse.ArgumentParser:
    """A command whose help is a docstring: a summary, a description, and an example."""
    summary, *rest = (" ".join(part.split()) for part in text.split("\n\n"))
    example = rest.pop() if rest and rest[-1].startswith("example") else None
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary[:1].lower() + summary[1:].rstrip("."),
        description=" ".join([summary, *rest]),
        epilog=example,
    )
    parser.set_defaults(usage_error=parser.error, **defaults)
    return parser


def title_for(address: str) -> str:
    """The title of a new map at that folder or address."""
    server = urlsplit(address).hostname
    return server or Path(address).stem


def keep_seconds(arguments: argparse.Namespace) -> float | None:
    """Seconds of `--keep`, None if it is not given; raises HistoryError for no duration."""
    from kg.history.timestamps import duration

    return None if arguments.keep is None else duration(arguments.keep)


def seconds_of(text: str) -> float:
    """A length of time above zero: seconds, or with a unit (90s, 10min)."""
    from kg.history.timestamps import duration
    from kg.model.errors import HistoryError

    try:
        return positive(str(duration(text)))
    except HistoryError:
        return positive(text)


def moment_of(text: str) -> str:
    """A moment that a person typed (yesterday, 2h, ISO 8601, #42) as ISO 8601 or #42.

    Raises HistoryError for other texts.
    """
    from kg.history.timestamps import instant

    return instant(text, time.time())


def now_of(semantic_map: SemanticMap, arguments: argparse.Namespace) -> float:
    """[s since 1970] the time of `--now`."""
    from kg.history.timestamps import moment
    from planner.search.goals.known_objects import map_time

    if arguments.now is None:
        return time.time()
    if arguments.now == "map":
        return map_time(semantic_map)
    when = moment_of(arguments.now)
    if when.startswith("#"):  # the time of a transaction
        when, _ = semantic_map.history.compare(when, when).times
    return moment(when)


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


_VIEWERS = """
--mcap OUT   record frames, boxes, map, robot and plan in a new MCAP file for Foxglove
--rerun OUT  record the same in a new .rrd file for Rerun
"""


def add_viewers(parser: argparse.ArgumentParser) -> None:
    """The options that `open_viewers` reads."""
    declare(parser, _VIEWERS)


@contextmanager
def open_viewers(arguments: argparse.Namespace, title: str) -> Iterator[Viewer | None]:
    """The viewers of the options as one viewer; None without any.

    Raises PictureError if a package is missing, or if a file exists or cannot be written. A viewer
    that fails later raises at the end of the context.
    """
    files = [(arguments.mcap, _mcap), (arguments.rerun, _rerun)]
    opened = [make(Path(path), title) for path, make in files if path is not None]
    if not opened:
        yield None
        return
    from hereabouts.display.viewers.viewer import ViewerGroup

    with closing(ViewerGroup(opened)) as viewers:
        yield viewers
    for path, _ in files:
        if path is not None and Path(path).exists():
            note(f"wrote {path}")


def _mcap(path: Path, title: str) -> Viewer:
    from hereabouts.display.viewers.viewer import require

    require("foxglove", "foxglove")
    from hereabouts.display.viewers.foxglove_viewer import McapFile

    return McapFile(path)


def _rerun(path: Path, title: str) -> Viewer:
    from hereabouts.display.viewers.viewer import require

    require("rerun", "rerun")
    from hereabouts.display.viewers.rerun_viewer import RerunFile

    return RerunFile(title, path)
