"""Write a recording of a simulated house with its truth, or run a robot in one."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import count, declare, positive, share
from hereabouts.cli.console import note, print_table, progress, write_json
from hereabouts.cli.live import until_signal
from hereabouts.cli.ros_connections import require_ros
from hereabouts.cli.search import add_hide, house_with

if TYPE_CHECKING:
    from lab.recordings.simulated_recording import SimulatedSession, SimulationOptions

_COLUMNS = ("folder", "frames", "objects", "detections", "moved", "carried", "vanished", "new")


def add(parser: argparse.ArgumentParser) -> None:
    subjects = parser.add_subparsers(dest="subject", metavar="SUBJECT", required=True)
    house = subjects.add_parser(
        "house",
        help="a random furnished house, seen by a robot with a depth camera",
        description="Generate a house, drive through all its rooms, and write the camera's frames "
        "as a recording that `map` reads: images, depth with a Kinect's noise, poses. Beside them: "
        "objects_full_gt.json (the complete truth, for `evaluate map`), detections.json (of a "
        "simulated detector, for --detector) and places.json (the rooms, for --places).",
        epilog="example: hereabouts simulate house --seed 7 --senses hard -o house7",
    )
    house.add_argument("--seed", type=count, required=True, metavar="N", help="seed of the house")
    house.add_argument(
        "--sessions",
        type=int,
        choices=(1, 2),
        default=1,
        help="2: a second recording after small things have moved (DIR/session-1, DIR/session-2)",
    )
    house.add_argument("-o", "--output", required=True, metavar="DIR", help="a new or empty folder")
    house.add_argument(
        "--size",
        type=_size,
        default=(640, 480),
        metavar="WxH",
        help="pixels of the images, 4:3 (default: 640x480)",
    )
    house.add_argument(
        "--senses",
        choices=("demo", "hard"),
        default="demo",
        help="errors of the detector: few with demo; hard has recall 0.7, confusion 0.08 and 0.3 "
        "false alarms per frame, some of them repeated (default: demo)",
    )
    house.add_argument(
        "--masks", action="store_true", help="let the detector give instance masks, 28 x 28 per box"
    )
    house.add_argument(
        "--odometry-noise",
        type=share,
        metavar="SHARE",
        help="error of each step of the written poses, e.g. 0.02 (default: true poses)",
    )
    declare(house, "--json")
    house.set_defaults(run=run_house)
    robot = subjects.add_parser(
        "robot",
        help="a robot in the demo's house, behind a ROS 1 master",
        description="Publish images and tf of a camera in the demo's house, and drive to the goals "
        "of /move_base, until Ctrl+C. This needs a ROS 1 master, e.g. roscore.",
        epilog="example: hereabouts simulate robot ros1://localhost --hide orange@7.05,8.3,0.85",
    )
    robot.add_argument("master", metavar="ros1|ros1://HOST[:PORT]", help="the ROS 1 master")
    add_hide(robot)
    robot.add_argument(
        "--rate",
        type=positive,
        default=1.0,
        metavar="N",
        help="move N times as fast as a real robot (default: 1)",
    )
    robot.add_argument("--seed", type=count, default=0, metavar="N", help="seed of the depth noise")
    robot.set_defaults(run=run_robot)


def run_house(arguments: argparse.Namespace) -> int:
    """Simulate, and say what lies where."""
    from lab.recordings.simulated_recording import simulate_house

    folder = Path(arguments.output)
    with progress() as bar:
        tasks = {}

        def on_frame(session: str, done: int, total: int) -> None:
            if session not in tasks:
                tasks[session] = bar.add_task(session, total=total, status="")
            bar.update(tasks[session], completed=done)

        written = simulate_house(
            folder, arguments.seed, arguments.sessions, _options(arguments), on_frame
        )
    if arguments.json:
        write_json([session.to_json() for session in written])
    else:
        _print(written)
    return 0


def run_robot(arguments: argparse.Namespace) -> int:
    """Be the robot until it is ended."""
    require_ros(arguments.master, "rosbags")
    from lab.robot.ros1_node import Ros1HouseNode
    from perception.sources.live.ros1 import Ros1Master

    master, house = Ros1Master.at(arguments.master), house_with(arguments.hide)
    start = house.rooms[0].viewpoints[0]
    with until_signal() as ended:
        node = Ros1HouseNode(master, house, start, rate=arguments.rate, seed=arguments.seed)
        note(f"a robot at ({start[0]:g}, {start[1]:g}), behind {master.address}; Ctrl+C ends it")
        node.run(ended)
    return 0


def _options(arguments: argparse.Namespace) -> SimulationOptions:
    from lab.recordings.hard_senses import SENSES
    from lab.recordings.simulated_recording import SimulationOptions

    return SimulationOptions(
        size=arguments.size,
        senses=SENSES[arguments.senses],
        odometry=arguments.odometry_noise or 0.0,
        masks=arguments.masks,
    )


def _print(written: list[SimulatedSession]) -> None:
    print_table(
        _COLUMNS, [tuple(session.to_json()[key] for key in _COLUMNS) for session in written]
    )
    folder = written[0].folder
    note(
        f"next: hereabouts map {folder} --into {folder.name}.map --scene none "
        f"--detector {folder}/detections.json"
    )


def _size(text: str) -> tuple[int, int]:
    """``WxH`` in pixels; argparse reports anything else as wrong usage."""
    match = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    width, height = (int(n) for n in match.groups()) if match else (0, 0)
    if not (80 <= width <= 1920 and 3 * width == 4 * height):
        raise argparse.ArgumentTypeError(f"needs WxH of 80x60 to 1920x1440, 4:3, got {text!r}")
    return width, height
