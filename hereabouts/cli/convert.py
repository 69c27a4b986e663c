"""Write a recording as an MCAP file, a ROS 1 bag or a ROS 2 bag.

The messages have types that ROS defines. Mapping the new file makes the same map as mapping the
recording.

example: hereabouts convert recordings/kitchen -o kitchen.mcap
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, progress, write_json
from hereabouts.cli.recording_options import (
    add_recording_arguments,
    opened_recording,
    recording_options,
)

_OPTIONS = """
RECORDING         folder, bag or MCAP file
-o, --output OUT  new file .mcap (ROS 2) or .bag (ROS 1); without an ending: folder of a ROS 2 bag
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, output={"required": True})
    add_recording_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    from perception.sources.bag_writer import write_bag

    path = arguments.recording
    recording = opened_recording(path, recording_options(arguments, path))
    output = Path(arguments.output)
    with progress() as bar:
        task = bar.add_task(recording.name, total=len(recording), status="")
        for _ in write_bag(recording, output):
            bar.advance(task)
    if arguments.json:
        write_json({"output": str(output), "frames": len(recording)})
    else:
        note(f"wrote {len(recording)} frames to {output}")
    return 0
