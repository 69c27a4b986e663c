"""Recordings: what they have, and their conversion."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, print_table, printable, progress, write, write_json
from hereabouts.cli.recording_options import (
    add_recording_arguments,
    opened_recording,
    recording_options,
)
from kg.model.errors import RecordingError

if TYPE_CHECKING:
    from perception.sources.depth_check import DepthFindings
    from perception.sources.listing import RecordingListing
    from perception.sources.recording import FolderRecording
    from perception.sources.recording_options import RecordingOptions
    from perception.sources.summary import StreamSummary

_INFO_OPTIONS = """
RECORDING  folder, bag or MCAP file
--json
"""


def add_info(parser: argparse.ArgumentParser) -> None:
    declare(parser, _INFO_OPTIONS)
    add_recording_arguments(parser)


def info(arguments: argparse.Namespace) -> int:
    """Show the streams of a recording, and whether they can be mapped.

    The table lists rates and gaps, and the streams that `map` would read. The lines below the table
    tell whether depth fits the poses, the camera and the colour images.

    example: hereabouts info kitchen.bag --color-topic /head/rgb/image_raw
    """
    from perception.sources.bags import bag
    from perception.sources.formats import format_of

    path = Path(arguments.recording)
    options = replace(recording_options(arguments, arguments.recording), check=False)
    if format_of(path, options.format) is bag.FORMAT:
        return _bag(arguments, path, options)
    recording = opened_recording(str(path), options)
    from perception.sources.summary import file_streams

    camera = recording.rectifier.camera
    streams = file_streams(recording.listing.entries, camera.size)
    return _print(arguments, streams, recording, {})


def _bag(arguments: argparse.Namespace, path: Path, options: RecordingOptions) -> int:
    """Print the streams of a bag, also of one that cannot be mapped."""
    from perception.sources.bags.bag import choose, listing_of, opened
    from perception.sources.bags.bag_index import read_index
    from perception.sources.summary import bag_streams

    index = read_index(opened(path))
    streams = options.streams
    choice = None
    try:
        choice = choose(index, streams)
        listing: RecordingListing = listing_of(index, choice, streams)
        recording = opened_recording(str(path), options, listing)
    except RecordingError:
        _print_streams(arguments, bag_streams(index, choice))
        raise
    used: dict[str, Any] = {
        "poses": choice.posed if options.poses is None else str(options.poses),
        "pairs": f"colour and depth within {streams.tolerance:g} s",
        "depth": f"registered from {choice.depth.frame}"
        if choice.depth_apart
        else "registered to colour",
    }
    return _print(arguments, bag_streams(index, choice), recording, used)


def _print_streams(arguments: argparse.Namespace, streams: list[StreamSummary]) -> None:
    if not arguments.json:
        print_table(
            ("stream", "holds", "count", "Hz", "gap s", "frame", "read for"),
            [(s.name, s.holds, s.count, s.rate, s.gap, s.frame, s.use) for s in streams],
        )


def _print(
    arguments: argparse.Namespace,
    streams: list[StreamSummary],
    recording: FolderRecording,
    used: dict[str, Any],
) -> int:
    from perception.sources.depth_check import depth_findings

    entries = recording.listing.entries
    findings = depth_findings(
        recording.name,
        [entry.T_world_cam for entry in entries],
        "camera-to-world",
        recording.depth_scale,
        recording.frame,
    )
    if recording.estimate is not None:
        used = {**used, "poses": f"estimated: {recording.estimate.summary()}"}
    facts = _facts(recording) | used | _depth_facts(findings)
    if arguments.json:
        write_json(facts | {"streams": [stream.to_json() for stream in streams]})
    else:
        _print_streams(arguments, streams)
        write("")
        width = max(map(len, facts))
        for name, value in facts.items():
            write(f" {name:{width}}  {printable(str(value))}")
    if findings.error is not None:
        raise RecordingError(findings.error)
    return 0


def _facts(recording: FolderRecording) -> dict[str, Any]:
    camera, entries = recording.rectifier.camera, recording.listing.entries
    distorted = "undone" if camera.distorted else "none"
    return {
        "name": recording.name,
        "format": recording.format,
        "frames": len(entries),
        "seconds": round(entries[-1].stamp - entries[0].stamp, 3),
        "camera": f"{camera.width}x{camera.height}, f {camera.fx:.1f} {camera.fy:.1f}, "
        f"c {camera.cx:.1f} {camera.cy:.1f}, distortion {distorted}",
        "depth units": f"{recording.depth_scale:g} per metre",
    }


def _depth_facts(findings: DepthFindings) -> dict[str, Any]:
    """Agreement of depth with poses, which tests scale and intrinsics, and with colour edges."""
    share, edges = findings.share, findings.registration
    too_few = "too few points to tell"
    facts = {
        "depth and poses": too_few
        if share is None
        else f"{100 * share:.0f} % of points agree (85 % and more is good)",
        "depth edges": too_few
        if edges is None
        else f"{edges.pixels:.0f} px of 640 from colour edges (6 and less is registered)",
    }
    for warning in findings.warnings:
        facts["warning"] = "; ".join(filter(None, (facts.get("warning", ""), warning)))
    return facts


_CONVERT_OPTIONS = """
RECORDING         folder, bag or MCAP file
-o, --output OUT  new file .mcap (ROS 2) or .bag (ROS 1); without an ending: folder of a ROS 2 bag
--json
"""


def add_convert(parser: argparse.ArgumentParser) -> None:
    declare(parser, _CONVERT_OPTIONS, output={"required": True})
    add_recording_arguments(parser)


def convert(arguments: argparse.Namespace) -> int:
    """Write a recording as an MCAP file, a ROS 1 bag or a ROS 2 bag.

    The messages have types that ROS defines. Mapping the new file makes the same map as mapping the
    recording.

    example: hereabouts convert recordings/kitchen -o kitchen.mcap
    """
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
