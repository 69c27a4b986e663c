"""Recordings that do not fit: what is noticed, and how well `--align` lays one on another.

    python -m benchmarks.recording_fit check RECORDING ...
    python -m benchmarks.recording_fit align RECORDING [RECORDING] [--detections FILE] [--trials N]

`check` damages each recording in turn (depth scale, poses, registration, a jump, slow drift) and
prints what is said of it. `align` maps the first half of a recording, or the first of two
recordings of one world, gives the other a world of its own, turned and moved at random (any
rotation, up to 5 m), and prints the errors of the transform found. Rows are Markdown.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import LayoutError, RecordingError
from kg.serving.opening import in_memory_map
from lab.command_line import parser_of
from mapping.alignment.recording_fit import aligned
from mapping.alignment.search import about_z
from mapping.frames.pose_monitor import PoseMonitor
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from perception.camera.gravity_alignment import gravity_aligned_transform
from perception.camera.poses import CONVENTIONS, Pose
from perception.frames import Frame
from perception.inference.recorded_detections import load_recorded_detections
from perception.sources.depth_check import check_depth, depth_findings
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions

Floats = NDArray[np.float64]
_MISREAD = ("world-to-camera", "opengl")  # conventions that undo themselves
_SHIFT = 0.3  # [m] of the jump and of the drift at the end, along x and along y
_TURN = np.radians(10.0)  # of the drift at the end


class _Warnings(logging.Handler):
    """Warnings, by their first words."""

    def __init__(self) -> None:
        super().__init__()
        self.said = list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


def check(folders: list[Path]) -> Iterator[str]:
    """Rows of what is said of each damaged recording."""
    names = ("as it is", "depth x 5", "depth / 5", *_MISREAD, "unregistered")
    yield f"| recording | {' | '.join((*names, 'jump', 'drift', 'ms a frame'))} |"
    yield "|---" * (len(names) + 4) + "|"
    for folder in folders:
        recording = open_recording(folder, RecordingOptions(check=False))
        poses = [entry.T_world_cam for entry in recording.listing.entries]
        scale = recording.depth_scale
        said = [
            _said(poses, scale, recording.frame),
            _said(poses, scale / 5, _scaled(recording.frame, 5.0)),
            _said(poses, scale * 5, _scaled(recording.frame, 0.2)),
            *(
                _said([CONVENTIONS[name](T) for T in poses], scale, recording.frame)
                for name in _MISREAD
            ),
            _said(poses, scale, _unregistered(recording.frame)),
        ]
        found = _monitored(recording)
        yield f"| {_name(folder)} | {' | '.join((*said, *found))} |"


def _name(folder: Path) -> str:
    return (
        folder.name if folder.parent.name in ("", "rgbd") else f"{folder.parent.name}/{folder.name}"
    )


def _said(poses: list[Pose], scale: float, frame_at: Callable[[int], Frame]) -> str:
    warnings = _Warnings()
    logging.getLogger().addHandler(warnings)
    try:
        check_depth(depth_findings("x", poses, "camera-to-world", scale, frame_at))
    except RecordingError as error:
        option = str(error).split(" would work")[0].split("--")[-1]
        return f"refused: {option}"
    finally:
        logging.getLogger().removeHandler(warnings)
    return (
        "; ".join(
            "warned: " + ("registration" if "registered" in w else "poses") for w in warnings.said
        )
        or "-"
    )


def _scaled(frame_at: Callable[[int], Frame], factor: float) -> Callable[[int], Frame]:
    def read(index: int) -> Frame:
        frame = frame_at(index)
        return replace(frame, depth=frame.depth * np.float32(factor))

    return read


def _unregistered(frame_at: Callable[[int], Frame]) -> Callable[[int], Frame]:
    """Depth as a depth camera of a Kinect sees it: focal length 1.1 times colour's, beside it."""

    def read(index: int) -> Frame:
        frame = frame_at(index)
        height, width = frame.depth.shape
        M = np.array([[1.1, 0, -0.05 * width + width / 80], [0, 1.1, -0.05 * height]], np.float32)
        depth = cv2.warpAffine(
            frame.depth, M, (width, height), flags=cv2.INTER_NEAREST, borderValue=float("nan")
        )
        return replace(frame, depth=np.asarray(depth, np.float32))

    return read


def _monitored(recording: FolderRecording) -> tuple[str, str, str]:
    """Warnings of a jump and of drift, and the cost; "false alarm" for unchanged poses."""
    sound, jump, drift = PoseMonitor("x"), PoseMonitor("x"), PoseMonitor("x")
    middle, spent = len(recording) // 2, 0.0
    about = recording.frame(middle).T_map_cam[:3, 3]
    logging.disable(logging.WARNING)
    for index, frame in enumerate(recording.frames()):
        before = time.process_time()
        sound.add(frame)
        spent += time.process_time() - before
        share = index / len(recording)
        jumped = about_z(0.0, _SHIFT, _SHIFT) if index >= middle else np.eye(4)
        jump.add(replace(frame, T_map_cam=jumped @ frame.T_map_cam))
        turn = about_z(_TURN * share)
        turn[:3, 3] = about - turn[:3, :3] @ about + share * np.array([_SHIFT, _SHIFT, 0.0])
        drift.add(replace(frame, T_map_cam=turn @ frame.T_map_cam))
    logging.disable(logging.NOTSET)
    false = f"false alarm: {', '.join(sound.problems)}; " if sound.problems else ""
    told = [false + (", ".join(m.problems) or "-") for m in (jump, drift)]
    return told[0], told[1], f"{1000 * spent / len(recording):.2f}"


def align(folders: list[Path], detections: str, trials: int) -> Iterator[str]:
    """Rows of the errors of alignments."""
    one, other = _two(folders)
    detector = load_recorded_detections(_inside(folders[0], detections), threshold=0.2)
    second = load_recorded_detections(_inside(folders[-1], detections), threshold=0.2)
    rng = np.random.default_rng(0)
    yield "| trial | error [m] | error [degrees] | of it tilt | seconds | found |"
    yield "|---|---|---|---|---|---|"
    with in_memory_map() as semantic_map:
        map_recording(one, semantic_map, detector, options=MappingOptions(check_poses=False))
        for trial in range(trials):
            M = _random_motion(rng)
            moved = _moved(other, M)
            before = time.perf_counter()
            try:
                placed, told = aligned(moved, semantic_map, second)
            except LayoutError as error:
                yield f"| {trial} | - | - | - | {time.perf_counter() - before:.0f} | {error} |"
                continue
            off = np.linalg.inv(one.T_map_world) @ placed.T_map_world @ M
            seen = np.mean([e.T_world_cam[:3, 3] for e in other.listing.entries], axis=0)
            distance = np.linalg.norm(off[:3, :3] @ seen + off[:3, 3] - seen)
            turn = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
            R = placed.T_map_world[:3, :3] @ M[:3, :3] @ one.T_map_world[:3, :3].T
            tilt = np.degrees(np.arccos(np.clip(R[2, 2], -1, 1)))
            yield (
                f"| {trial} | {distance:.3f} | {turn:.2f} | {tilt:.2f} | "
                f"{time.perf_counter() - before:.0f} | {told.split('; ')[1]} |"
            )


def _inside(folder: Path, name: str) -> Path:
    return folder / name if (folder / name).is_file() else Path(name)


def _two(folders: list[Path]) -> tuple[FolderRecording, FolderRecording]:
    """Both recordings, or the two halves of one."""
    recordings = [open_recording(folder, RecordingOptions(check=False)) for folder in folders]
    if len(recordings) == 2:
        return recordings[0], replace(recordings[1], name="other")
    entries = recordings[0].listing.entries
    halves = entries[: len(entries) // 2], entries[len(entries) // 2 :]
    one, other = (
        replace(recordings[0], listing=replace(recordings[0].listing, entries=half))
        for half in halves
    )
    return one, replace(other, name="other")


def _moved(recording: FolderRecording, M: Floats) -> FolderRecording:
    """The recording in a world of its own, stood upright by the surfaces it shows."""
    entries = tuple(
        replace(entry, T_world_cam=M @ entry.T_world_cam) for entry in recording.listing.entries
    )
    moved = replace(recording, listing=replace(recording.listing, entries=entries))
    moved = moved.placed(np.eye(4))
    return moved.placed(gravity_aligned_transform(moved))


def _random_motion(rng: np.random.Generator) -> Floats:
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    M = np.eye(4)
    M[:3, :3] = q * np.sign(np.linalg.det(q))
    M[:3, 3] = rng.uniform(-5, 5, 3)
    return M


def main() -> None:
    """Run one of the two."""
    parser = parser_of("benchmarks.recording_fit", __doc__)
    parser.add_argument("what", choices=("check", "align"))
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--detections", default="detections.json")
    parser.add_argument("--trials", type=int, default=10)
    given = parser.parse_args()
    rows = (
        check(given.recordings)
        if given.what == "check"
        else align(given.recordings, given.detections, given.trials)
    )
    for row in rows:
        sys.stdout.write(row + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
