"""Search for objects with a robot: drive, look, plan again, until found or given up.

Looks and findings are written to the map as they happen. Ctrl+C stops the robot, and --resume
continues later. Progress is printed on stderr, the outcome on stdout (with --robot stdio on
stderr). Exit code 0: found, 3: given up, 4: the robot ended the search, 130: stopped.

example: hereabouts search demo.map apple --robot sim
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import (
    MAX_DISTANCE,
    add_viewers,
    count,
    declare,
    open_viewers,
    positive,
    seconds_of,
    share,
    title_for,
)
from hereabouts.cli.console import note, write
from hereabouts.cli.mapping_options import labels_of
from hereabouts.cli.ros_connections import (
    add_ros_arguments,
    check_no_ros_arguments,
    is_ros,
    open_ros_robot,
    ros_options,
)
from kg.model.errors import LayoutError, did_you_mean
from kg.model.extensions import ROBOTS, extensions
from planner.settings import BELIEF

if TYPE_CHECKING:
    from hereabouts.display.viewers.viewer import Viewer
    from kg.maps.semantic_map import SemanticMap
    from planner.execution.options import Event, SearchOptions
    from planner.execution.robot import Robot
    from planner.simulation.house import House, Item


def add_hide(parser: argparse.ArgumentParser, whose: str = "") -> None:
    """Declare `--hide`, which `house_with` reads."""
    parser.add_argument(
        "--hide",
        action="append",
        metavar="LABEL@X,Y,Z",
        help=f"{whose}an object that is placed in the house after mapping (default: apple, the "
        "demo's own, which needs no @X,Y,Z)",
    )


def house_with(hidden: Sequence[str] | None) -> House:
    """The demo's house with the objects of `--hide`; raises LayoutError."""
    from hereabouts.demo.house_demo import HIDDEN
    from planner.simulation.house import furnished_house

    own = {HIDDEN.label: HIDDEN}
    items = [own.get(text) or _item(text) for text in hidden or own]
    return furnished_house().with_objects(items)


def _item(text: str) -> Item:
    from planner.simulation.house import OBJECTS, Item

    label, _, where = text.partition("@")
    try:
        x, y, z = (float(part) for part in where.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(abs(value) <= MAX_DISTANCE for value in (x, y, z)):
        raise LayoutError(
            f"--hide needs LABEL@X,Y,Z in metres, e.g. {label or 'apple'}@7,8.3,0.85, got {text!r}"
        )
    if label not in OBJECTS:
        near = did_you_mean(label, list(OBJECTS)) or f"; it has {', '.join(sorted(OBJECTS))}"
        raise LayoutError(f"the simulated house has no {label!r}{near}")
    return Item(label, x, y, z)


#: exit codes; 1 is an error, 2 wrong usage
FOUND: Final = 0
GIVEN_UP: Final = 3
ABORTED: Final = 4
#: + the signal's number, as shells have it: 130 after Ctrl+C, 143 after SIGTERM
STOPPED: Final = 128

_ROBOT = (
    "sim: the simulated robot of the demo house; stdio:COMMAND: a program with the line "
    "protocol of docs/reference/robot-protocol.md; stdio: the parent process, on stdin and stdout; "
    "http://...: a robot behind that address; ros1://HOST[:PORT], or ros1 (ROS_MASTER_URI): "
    "move_base and a camera behind a ROS 1 master; ros2://DOMAIN: Nav2 over DDS, by /goal_pose; "
    "ws://HOST:PORT: Nav2 behind foxglove_bridge with include_hidden:=true"
)


_OPTIONS = f"""
MAP
[OBJECT ...]    what to find, e.g. banana, sofa, 'something to drink from'; optional with --resume
--robot ROBOT   {_ROBOT}
--budget TIME   give up after this time of the robot's clock: 300, 90s, 10min (default:
                no limit)
--give-up-at P  give up once the probability that the looks missed an object on this floor is below
                P (default: {BELIEF.stop_below:g})
--resume        continue the latest search that did not find everything
--patience S    maximum seconds without a message of the robot (default: 30)
--labels-map
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _OPTIONS,
        robot={"required": True},
        budget=seconds_of,
        give_up_at={"type": share, "default": BELIEF.stop_below},
        patience={"type": positive, "default": 30.0},
    )
    add_hide(parser, "sim: ")
    parser.add_argument(
        "--seed",
        type=count,
        default=0,
        metavar="N",
        help="sim: seed of sensing errors (default: 0)",
    )
    add_ros_arguments(parser)
    add_viewers(parser)
    parser.add_argument("--json", action="store_true", help="print each event as a line of JSON")


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map

    _check_usage(arguments)
    from planner.execution.search_loop import search

    with (
        open_viewers(arguments, title_for(arguments.map)) as viewer,
        open_map(arguments.map) as semantic_map,
        _signals() as caught,
    ):
        robot = _robot(arguments, semantic_map)
        options = replace(
            search_options(arguments),
            stopping=lambda: bool(caught),
            clock=_clock(robot, semantic_map),
        )
        if viewer is not None:
            robot, options = _watched(semantic_map, viewer, robot, options)
        outcome = search(semantic_map, arguments.object, robot, options, resume=arguments.resume)
    if not arguments.json and arguments.robot != "stdio":
        write(outcome.line)
    if outcome.state == "stopped":
        return STOPPED + caught[0] if caught else ABORTED
    return FOUND if outcome.state == "found" else GIVEN_UP


def search_options(arguments: argparse.Namespace) -> SearchOptions:
    """Options of the search."""
    from planner.execution.options import SearchOptions

    return SearchOptions(
        budget=arguments.budget,
        give_up_at=arguments.give_up_at,
        timeout=arguments.patience,
        labels=labels_of(arguments),
        on_event=_event_sink(arguments),
    )


def _check_usage(arguments: argparse.Namespace) -> None:
    if not arguments.object and not arguments.resume:
        arguments.usage_error("give an OBJECT to find, or --resume")
    if arguments.robot == "stdio" and arguments.json:
        arguments.usage_error("--json and --robot stdio both use stdout; give stdio:COMMAND")
    if arguments.robot != "sim" and arguments.hide:
        arguments.usage_error("--hide needs --robot sim")
    if is_ros(arguments.robot):
        return
    check_no_ros_arguments(arguments)
    known = arguments.robot in ("sim", "stdio")
    known |= _scheme(arguments.robot) in extensions(ROBOTS)
    if not known and not arguments.robot.startswith(("stdio:", "http://", "https://")):
        added = "".join(f", {scheme}://" for scheme in sorted(extensions(ROBOTS)))
        arguments.usage_error(
            f"no robot {arguments.robot!r}; give sim, stdio, stdio:COMMAND, http://, ros1://, "
            f"ros2:// or ws://{added}"
        )


def _scheme(address: str) -> str:
    """``http`` of ``http://...``; "" of what has none."""
    scheme, there, _ = address.partition("://")
    return scheme if there else ""


def _robot(arguments: argparse.Namespace, semantic_map: SemanticMap) -> Robot:
    if arguments.robot == "sim":
        from planner.simulation.house_robot import simulated_robot

        return simulated_robot(semantic_map, house_with(arguments.hide), seed=arguments.seed)
    if is_ros(arguments.robot):
        return open_ros_robot(arguments.robot, ros_options(arguments))
    if _scheme(arguments.robot) in extensions(ROBOTS):
        from planner.execution.robot import AddedRobot

        return AddedRobot(arguments.robot)
    if arguments.robot.startswith("http"):
        from planner.execution.transports.http_transport import HttpRobot

        return HttpRobot(arguments.robot)
    from planner.execution.transports.line_transport import ChildRobot, on_our_own_pipes

    if arguments.robot == "stdio":
        return on_our_own_pipes()
    return ChildRobot(arguments.robot.removeprefix("stdio:"))


def _clock(robot: Robot, semantic_map: SemanticMap) -> Callable[[], float]:
    """Clock for times in the map: the computer's, or the simulated house's."""
    from planner.simulation.house_robot import SimulatedHouseRobot

    mapped = semantic_map.robot()
    if not isinstance(robot, SimulatedHouseRobot) or mapped is None:
        return time.time
    begin = mapped.stamp
    return lambda: begin + robot.seconds


def _event_sink(arguments: argparse.Namespace) -> Callable[[Event], None]:
    def on_event(event: Event) -> None:
        if arguments.json:
            write(json.dumps(event.to_json(), ensure_ascii=False, allow_nan=False))
            sys.stdout.flush()
        else:
            seconds = float(event.data.get("seconds", 0.0))
            note(f"{seconds:7.1f} s  {event.text}")

    return on_event


def _watched(
    semantic_map: SemanticMap, viewer: Viewer, robot: Robot, options: SearchOptions
) -> tuple[Robot, SearchOptions]:
    """The same robot and options, whose poses and events also go to a viewer."""
    from hereabouts.display.viewers.feed import SearchFeed, WatchedRobot

    feed = SearchFeed(semantic_map, viewer, options.clock)

    def on_event(event: Event) -> None:
        options.on_event(event)
        feed.on_event(event)

    return WatchedRobot(robot, feed), replace(options, on_event=on_event)


@contextmanager
def _signals() -> Iterator[list[int]]:
    """The received signals to stop; a second one interrupts at once."""
    caught: list[int] = []

    def receive(number: int, frame: object) -> None:
        if caught:
            raise KeyboardInterrupt
        caught.append(number)

    before = {n: signal.signal(n, receive) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
