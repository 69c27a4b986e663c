"""Map frames as they arrive: from a camera, ROS 1 or 2, a Foxglove WebSocket or a growing folder.

Ctrl+C or SIGTERM ends the mapping after a whole frame; a new run continues. A frame that arrives
while earlier ones are mapped is dropped and counted if a newer one follows. Frames of a folder are
all mapped.

example: hereabouts live ros1://localhost:11311 --into kitchen.map
"""

from __future__ import annotations

import argparse
import signal
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from functools import partial
from itertools import chain, count
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import (
    declare,
    end_at_latest,
    open_viewers,
    positive,
    title_for,
    whole,
)
from hereabouts.cli.console import note
from hereabouts.cli.live_outages import MappedFrames, through_outages
from hereabouts.cli.map_recording import (
    add_map_options,
    map_frames,
    open_for_mapping,
    print_outcome,
)
from hereabouts.cli.mapping_options import (
    Networks,
    add_mapping_arguments,
    add_network_arguments,
    mapping_options,
    network_options,
    open_networks,
)
from hereabouts.cli.recording_options import add_source_arguments, source_options
from hereabouts.cli.ros_connections import (
    PUBLISH,
    REALSENSE,
    SOURCES,
    connection_to,
    publish_to,
)
from hereabouts.cli.teach import with_taught_rooms
from kg.model.errors import RecordingError

if TYPE_CHECKING:
    from hereabouts.cli.ros_connections import Publish
    from hereabouts.display.viewers.viewer import Viewer
    from kg.maps.semantic_map import SemanticMap
    from mapping.alignment.pose_correction import LiveCorrection
    from mapping.mapping_options import MappingOptions
    from mapping.recording_mapper import OnDetections
    from mapping.runs.progress_report import MappingReport
    from perception.frames import Detections, Frame, Recording, SceneScores
    from perception.sources.live.cameras import CameraStreams
    from perception.sources.live.connection import Connection
    from perception.sources.live.live_recording import LiveRecording
    from perception.sources.live.silence import StreamCounts
    from perception.sources.live.stream import FrameStream
    from perception.sources.recording_options import RecordingOptions

_OPTIONS = f"""
--camera NAME[@RATE] ... -> cameras
                a camera of several, each given once: a name in its topics (/NAME/...), or its topic
                of colour images; front@2: at most 2 of its frames a second
--limit N       end after N frames
--idle SECONDS  end after so long without a frame
--loops TOPIC   what was mapped follows the robot's own SLAM, by its corrected path (nav_msgs/Path,
                or RTAB-Map's MapGraph); tf: where map -> odom jumps
--publish [TO]  {PUBLISH}
--publish-tf OBJECT ...
                an object whose pose is published as a frame of tf, too: the surest of its kind, or
                object/N; given once for each
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, f"SOURCE -> recording  {SOURCES}")
    add_map_options(parser)
    declare(parser, _OPTIONS, limit=whole, idle=positive, publish={"const": ""})
    add_source_arguments(parser)
    add_network_arguments(parser)
    add_mapping_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    connection = connection_to(arguments.recording)
    publish = publish_to(arguments, arguments.recording)
    if connection is not None and (arguments.format != "auto" or arguments.same_frame):
        arguments.usage_error(
            "--format and --same-frame need a folder; poses of topics have a map frame "
            "(--map-frame)"
        )
    if arguments.cameras:
        _check_cameras(arguments, connection)
    if arguments.loops is not None and not _has_topics(connection):
        arguments.usage_error("--loops needs a source with topics: ros1://, ros2:// or ws://")
    source, options = source_options(arguments), mapping_options(arguments)
    if connection is not None and connection.address.startswith(REALSENSE):
        source = replace(source, estimate_poses=True)
    named = network_options(arguments)
    networks = open_networks(named, arguments.recording, live=connection is not None)
    prepare = _folder_run if connection is None else partial(_stream_run, connection)
    with until_signal() as ended, open_viewers(arguments, title_for(arguments.into)) as viewer:
        mapped = MappedFrames()
        run = prepare(arguments, source, networks, options, viewer, ended, mapped, publish)
        if run is None:
            raise RecordingError(f"{arguments.recording}: no frame was mapped")
        through_outages(arguments.into, ended, mapped, run)
    return 0 if mapped.count or connection is None else 1


def _check_cameras(arguments: argparse.Namespace, connection: Connection | None) -> None:
    """End the program, as wrong usage, where several cameras do not go with source or options."""
    if not _has_topics(connection):
        arguments.usage_error("--camera needs a source with topics: ros1://, ros2:// or ws://")
    names = ("colour", "depth", "camera", "camera_frame", "camera_in", "intrinsics", "loops")
    if any(getattr(arguments, name) is not None for name in names):
        arguments.usage_error(
            "--color-topic, --depth-topic, --info-topic, --camera-frame, --camera-in, "
            "--intrinsics and --loops are of one camera, and --camera names those of several"
        )
    topic = arguments.detector or ""
    if topic.startswith("topic:") and "{camera}" not in topic:
        arguments.usage_error(
            f"--detector {topic} is of one camera; --detector topic:/{{camera}}/detections, with "
            "the name of each for {camera}, would work"
        )


def _has_topics(connection: Connection | None) -> bool:
    return connection is not None and not connection.address.startswith(REALSENSE)


@contextmanager
def until_signal() -> Iterator[threading.Event]:
    """An event that the first Ctrl+C or SIGTERM sets; a second one ends the program."""
    ended = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield ended  # only the main thread receives signals
        return
    numbers = (signal.SIGINT, signal.SIGTERM)

    def end(number: int, frame: object) -> None:
        ended.set()
        if number == signal.SIGTERM:
            end_at_latest()
        for each in numbers:
            signal.signal(each, before[each])

    before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield ended
    finally:
        for number in numbers:
            signal.signal(number, before[number])


def _stream_run(
    connection: Connection,
    arguments: argparse.Namespace,
    source: RecordingOptions,
    networks: Networks,
    options: MappingOptions,
    viewer: Viewer | None,
    ended: threading.Event,
    mapped: MappedFrames,
    publish: Publish,
) -> Callable[[], None]:
    """A function that maps a connection's frames until it is ended."""
    from mapping.alignment.pose_correction import LiveCorrection
    from perception.sources.live.live_recording import KeptFrames, LiveRecording

    stream = _stream_of(connection.address, arguments, source, networks)

    def run() -> None:
        name, limit = source.name or "live", mapped.left(arguments.limit)
        recording = LiveRecording(name, connection, stream, ended, limit, arguments.idle)
        note(f"listening to {connection.address}; Ctrl+C ends it")
        recording.level("z" if source.up is None else source.up, check=source.check)
        if recording.is_empty and not mapped.count:
            recording.close()
            counts = _counts_line(_as_json(stream.counts, 0))
            raise RecordingError(stream.problem or f"{connection.address}: {counts}")
        with (
            closing(recording),
            KeptFrames() as kept,
            open_for_mapping(arguments, options, viewer) as (semantic_map, on_detections),
            ExitStack() as stack,
        ):
            taught = with_taught_rooms(networks, arguments.into)
            taught = _placed(recording, semantic_map, taught)
            choice = stream.choice
            frame = "" if choice is None or choice.poses is None else choice.map_frame
            stack.enter_context(publish(semantic_map, frame, lambda: recording.T_map_world))
            correction = LiveCorrection(recording, kept)
            counted = mapped.counted(_keeping(correction, on_detections))

            def map_into(
                one: Recording, into: SemanticMap, options: MappingOptions
            ) -> MappingReport:
                if one is not recording:
                    return map_frames(one, into, taught, options)
                return map_frames(
                    recording,
                    into,
                    taught,
                    options,
                    on_detections=counted,
                    lost=lambda: f"{stream.counts.dropped} dropped",
                )

            report = correction.run(semantic_map, map_into, options, note)
            numbers = _as_json(stream.counts, mapped.count) | _tracking(recording, correction)
            cameras = stream.cameras if arguments.cameras else ()
            each = {c.camera: _as_json(c.counts, mapped.by_camera[c.camera]) for c in cameras}
            more = numbers | ({"cameras": each} if each else {})
            print_outcome(semantic_map, report, arguments, networks.device, more)
            for camera, of_camera in each.items():
                note(f"camera {camera}: {_counts_line(of_camera)}")
            note(_counts_line(numbers))

    return run


def _tracking(recording: LiveRecording, correction: LiveCorrection) -> dict[str, int]:
    """Counts of tracking and of corrections; notes on them are printed."""
    numbers = dict[str, int]()
    if (tracker := recording.tracker) is not None:
        numbers = {"tracked": tracker.tracked, "lost": tracker.lost}
        cost = 1000 * tracker.seconds / max(tracker.tracked + tracker.lost, 1)
        note(f"tracking took {cost:.0f} ms of a core an image")
    if (loops := recording.stream.cameras[0].loops) is not None and loops.is_silent:
        note(f"no message of {loops.topic} came that tells a path, so that nothing moved")
    if recording.corrector is not None:
        numbers["corrections"] = correction.corrections
        _note_corrections(correction, recording.corrector.moved)
    return numbers


def _stream_of(
    address: str, arguments: argparse.Namespace, source: RecordingOptions, networks: Networks
) -> FrameStream | CameraStreams:
    """The stream of a connection's frames: of the named cameras, or of the one that it finds."""
    from perception.sources.live.cameras import CameraStreams
    from perception.sources.live.loop_closures import LoopClosures
    from perception.sources.live.stream import FrameStream
    from perception.sources.live.topic_detector import TopicDetector

    detector = networks.detector if isinstance(networks.detector, TopicDetector) else None
    if arguments.cameras:
        return CameraStreams(address, arguments.cameras, source, detector)
    loops = None if arguments.loops is None else LoopClosures(arguments.loops)
    return FrameStream(address, source, detector, loops)


def _placed(recording: LiveRecording, semantic_map: SemanticMap, networks: Networks) -> Networks:
    """Put a recording where the map has it; the networks that map it.

    A tracked camera is looked for in the map. Where poses are corrected, each run is a recording
    of its own, and detections are kept. Raises LayoutError where it is not sure.
    """
    from perception.inference.detector_pair import RememberingDetector
    from perception.sources.live.live_recording import MAX_FRAMES

    known = {one.name: one.T_map_world for one in semantic_map.recordings()}
    if recording.tracker is None:
        recording.T_map_world = known.get(recording.name, recording.T_map_world)
        if recording.corrector is None:
            return networks
        recording.name = _new_name(recording.name, known)
    elif known:
        _place(recording, semantic_map)
    return replace(networks, detector=RememberingDetector(networks.detector, MAX_FRAMES))


def _place(recording: LiveRecording, semantic_map: SemanticMap) -> None:
    """Find the live camera in a map that holds others; raises LayoutError where it is not sure."""
    from mapping.alignment.relocalisation import recognised_live

    names = {one.name for one in semantic_map.recordings()}
    recording.name = _new_name(recording.name, names)
    note(f"looking for the place in the map of {', '.join(sorted(names))}; nothing is mapped yet")
    T, line = recognised_live(recording.name, recording.views(), semantic_map)
    recording.T_map_world, recording.found = T @ recording.T_map_world, line
    note(f"{recording.name} was {line}")


def _new_name(name: str, known: Collection[str]) -> str:
    """The name of a run that is corrected alone, by a number where the name is known."""
    numbered = (f"{name}-{number}" for number in count(2))
    return next(one for one in chain([name], numbered) if one not in known)


def _keeping(correction: LiveCorrection, on_detections: OnDetections | None) -> OnDetections:
    """A callback for each mapped frame, which is kept for corrections first."""

    def keep(frame: Frame, detections: Detections, scene: SceneScores | None) -> None:
        correction.keep(frame)
        if on_detections is not None:
            on_detections(frame, detections, scene)

    return keep


def _note_corrections(correction: LiveCorrection, moved: float) -> None:
    """Print how far loops moved images that were mapped before, where the map does not follow."""
    from mapping.alignment.pose_correction import MOVED

    if moved > MOVED:
        note(
            f"loops moved the camera by up to {moved:.2f} m after its images were mapped, and what "
            f"was mapped stays, since no more than {len(correction.kept)} frames are kept; a "
            "recording of the same images, mapped by `hereabouts map`, follows its loops"
        )


def _as_json(counts: StreamCounts, frames: int) -> dict[str, Any]:
    return {
        "frames": frames,
        "received": counts.received,
        "dropped": counts.dropped + counts.taken - frames,
        "without_depth": counts.without_depth,
        "without_pose": counts.without_pose,
        "unreadable": counts.unreadable,
    }


def _counts_line(numbers: Mapping[str, Any]) -> str:
    rest = ", ".join(
        f"{number} {name.replace('_', ' ')}" for name, number in numbers.items() if name != "frames"
    )
    return f"{numbers['frames']} frames mapped: {rest}"


def _folder_run(
    arguments: argparse.Namespace,
    source: RecordingOptions,
    networks: Networks,
    options: MappingOptions,
    viewer: Viewer | None,
    ended: threading.Event,
    mapped: MappedFrames,
    publish: Publish,
) -> Callable[[], None] | None:
    """A function that maps a growing folder's frames until it is ended; None without a frame."""
    from mapping.alignment.recording_fit import check_fit
    from mapping.runs.resumption import resumed
    from perception.sources.live.growing_folder import GrowingRecording, first_opened
    from perception.sources.recording import FolderRecording, open_recording

    path = arguments.recording
    source = replace(source, estimate_poses=False)
    first = first_opened(lambda: open_recording(path, source), ended, level=source.up is not None)
    if first is None:
        return None
    # each reopening has the same start time
    source = replace(source, check=False, start_time=first.start_time or None)

    def run() -> None:
        with (
            open_for_mapping(arguments, options, viewer) as (semantic_map, on_detections),
            publish(semantic_map, "", lambda: first.T_map_world),
        ):
            taught = with_taught_rooms(networks, arguments.into)
            placed = resumed(first, semantic_map)
            fit = check_fit(placed, semantic_map, same_frame=options.same_frame)

            def reopened() -> FolderRecording:
                return open_recording(path, replace(source, T_map_world=placed.T_map_world))

            limit = mapped.left(arguments.limit)
            recording = GrowingRecording(reopened(), reopened, ended, limit, arguments.idle)
            note(f"reading {arguments.recording} as it grows; Ctrl+C ends it")
            report = map_frames(
                recording,
                semantic_map,
                taught,
                options,
                on_detections=mapped.counted(on_detections),
                lost=lambda: "",
            )
            if fit:
                note(fit)
            numbers = {"frames": mapped.count}
            print_outcome(semantic_map, report, arguments, networks.device, numbers)

    return run
