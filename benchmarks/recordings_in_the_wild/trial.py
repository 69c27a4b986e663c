"""A trial of one kind: it is mapped, and the map compared with that of the plain recording."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.recordings_in_the_wild.folders import GRID
from benchmarks.recordings_in_the_wild.kind import Kind
from benchmarks.recordings_in_the_wild.robot import Shot, record
from hereabouts.cli.recording_options import add_recording_arguments, recording_options
from kg.model.errors import HereaboutsError
from perception.camera.poses import Pose
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions

HEREABOUTS: Final = (sys.executable, "-m", "hereabouts.cli")
MAP: Final = ("--scene", "none", "--surface", "none", "--no-floor", "--places", "one",
              "--no-pictures")  # fmt: skip
FAR: Final = 0.10  # [m] a thing may lie from where the plain recording has it
MIN_FRAMES: Final = 0.45  # share of the frames that must be mapped
OTHER_COLOUR: Final = 14.0  # mean difference of a pixel's colours that JPEG and YUV explain
BELIEVED: Final = 0.5


@dataclass(frozen=True, slots=True)
class Plain:
    """The plain recording, and its map."""

    folder: Path
    shots: Sequence[Shot]
    detections: Sequence[list[Any]]
    recording: FolderRecording
    parts: dict[tuple[Any, ...], list[dict[str, Any]]]

    def part(self, first: int, last: int, T: Pose) -> list[dict[str, Any]]:
        """Things of the map of a part of the frames, in a world that `T` (4, 4) gives."""
        key = (first, last, *np.round(T, 2).ravel().tolist())
        if key not in self.parts:
            times = [(self.shots[i].stamp - self.shots[0].stamp) / 1e9 for i in (first, last)]
            span = ("--from", times[0] - 0.01, "--to", times[1] + 0.01)
            name = f"plain-{len(self.parts)}"
            file = self.folder.parent / f"{name}.json"
            rows = (T @ self.recording.T_map_world).tolist()
            file.write_text(json.dumps({"sequences": {"plain": {"T_map_world": rows}}}))
            into = self.folder.parent / f"{name}.map"
            found = self.folder.parent / "detections.json"
            world = ("--transform", file, "--sequence", "plain")
            code, _, said = run(
                "map", self.folder, *world, "--into", into, "--detector", found, *span, *MAP
            )
            if code:
                raise RuntimeError(said)
            self.parts[key] = things(into)
        return self.parts[key]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Verdict on a kind, and the line that was said."""

    name: str
    verdict: str
    line: str

    @property
    def good(self) -> bool:
        """Whether nothing is silently wrong."""
        return self.verdict.startswith(("right", "refused, ", "told: "))


def run(*words: object, seconds: float = 300) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command."""
    environment = os.environ | {"COLUMNS": "10000"}
    try:
        done = subprocess.run(
            [*HEREABOUTS, *map(str, words)],
            env=environment, capture_output=True, text=True, timeout=seconds,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return 124, "", "timeout"
    return done.returncode, done.stdout, done.stderr


def opened(path: Path, words: Sequence[str]) -> FolderRecording:
    """The recording by the options of the command line."""
    import argparse

    parser = argparse.ArgumentParser()
    add_recording_arguments(parser)
    options = recording_options(parser.parse_args(list(words)), str(path))
    return open_recording(path, options)


def plain(folder: Path, shots: Sequence[Shot], detections: Sequence[list[Any]]) -> Plain:
    """The plain recording in `folder`, mapped."""
    recording = open_recording(folder, RecordingOptions(up="z"))
    detections_file(folder.parent / "detections.json", recording, shots, detections)
    return Plain(folder, shots, detections, recording, {})


def things(path: Path) -> list[dict[str, Any]]:
    """Objects of a map with their positions."""
    code, out, said = run("ask", path, "objects", "--all", "--json")
    if code:
        raise RuntimeError(said)
    rows: list[dict[str, Any]] = json.loads(out)
    return rows


def detections_file(
    path: Path,
    recording: FolderRecording,
    shots: Sequence[Shot],
    detections: Sequence[list[Any]],
    start: int = 0,
) -> Path:
    """Detections of each frame of the recording, by the frame's place in time."""
    frames = {
        entry.id: detections[_place(recording, index, shots, start)]
        for index, entry in enumerate(recording.listing.entries)
    }
    path.write_text(json.dumps({"name": "pair", "frames": frames}))
    return path


def _place(recording: FolderRecording, index: int, shots: Sequence[Shot], start: int = 0) -> int:
    """Index of the shot that a frame shows, by its stamp, or by the number in an image's name."""
    stamp = recording.listing.entries[index].stamp
    if stamp < 1e8 and recording.format != "bag":
        return int(re.findall(r"\d+", recording.listing.entries[index].id)[-1]) // GRID
    first = shots[start].stamp / 1e9
    stamp = stamp if stamp > 1e8 else first + stamp - recording.listing.entries[0].stamp
    return min(range(len(shots)), key=lambda i: abs(shots[i].stamp / 1e9 - stamp))


def difference(kind: Kind, made: FolderRecording, true: Plain) -> str | Pose:
    """The transform from the plain map to this one; or what is wrong with the frames."""
    least = MIN_FRAMES * len(true.shots)
    if len(made) < least:
        return f"{len(made)} of {len(true.shots)} frames"
    between = []
    for index in range(0, len(made), 3):
        frame, place = made.frame(index), _place(made, index, true.shots, kind.first)
        other = true.recording.frame(place)
        between.append(frame.T_map_cam @ np.linalg.inv(other.T_map_cam))
        if kind.turned:
            continue
        if frame.rgb.shape != other.rgb.shape:
            return f"images of {frame.rgb.shape}"
        off = float(np.abs(frame.rgb.astype(float) - other.rgb).mean())
        if kind.colour_as_is and off > OTHER_COLOUR:
            return f"colours differ by {off:.0f}"
        if np.abs(frame.K / np.where(other.K, other.K, 1) - np.sign(other.K)).max() > 0.02:
            return "another camera"
        apart = np.abs(frame.depth - other.depth)
        if not np.isfinite(apart).any() or np.nanpercentile(apart, 80) > 0.05:
            return "other depth"
    T: Pose = between[len(between) // 2]
    if T[2, 2] < np.cos(np.radians(4.0)):
        return "z is not up"
    if abs(T[2, 3]) > FAR:
        return f"the floor is off by {T[2, 3]:.2f} m"
    centres = [np.linalg.inv(true.recording.frame(i).T_map_cam)[:3, 3] for i in (0, 20)]
    spread = max(
        np.abs((one - T) @ [*(2 * centre), 1.0]).max() for one in between for centre in centres
    )
    return f"poses differ by {spread:.2f} m" if spread > FAR else T


def misplaced(found: list[dict[str, Any]], true: list[dict[str, Any]]) -> str:
    """Faults of a map's things; "" where each has its partner within FAR.

    A thing that one map believes must be in the other, which may believe it less.
    """
    if not any(map(_believed, found)):
        return "an empty map"
    wrong = []
    for a, b in ((true, found), (found, true)):
        for one in filter(_believed, a):
            same = [o for o in b if o["category"] == one["category"]]
            apart = [np.linalg.norm([one[x] - o[x] for x in "xyz"]) for o in same]
            if not apart or min(apart) > FAR:
                wrong.append(f"{one['category']} {min(apart, default=9):.2f}")
    return f"{len(wrong)} things are elsewhere ({', '.join(wrong)})" if wrong else ""


def _believed(thing: dict[str, Any]) -> bool:
    return bool(thing["existence"] >= BELIEVED)


def attempt(kind: Kind, path: Path, words: Sequence[str], true: Plain, scratch: Path
            ) -> tuple[int, str, str]:  # fmt: skip
    """Exit code, what was said, and what is wrong with the map ("": nothing)."""
    logging.disable(logging.CRITICAL)
    made: FolderRecording | None = None
    wrong, detector = "", list[str]()
    into = scratch / "made.map"
    shutil.rmtree(into, ignore_errors=True)
    try:
        made = opened(path, words)
        detector = [
            "--detector",
            detections_file(scratch / "d.json", made, true.shots, true.detections, kind.first),
        ]
    except (HereaboutsError, SystemExit) as error:
        wrong = str(error)
    code, _, said = run("map", path, "--into", into, *words, *detector, *MAP)
    if code or made is None:
        return code, said, wrong
    T = difference(kind, made, true)
    if isinstance(T, str) or kind.frames_only:
        return code, said, T if isinstance(T, str) else ""
    first, last = (_place(made, index, true.shots, kind.first) for index in (0, len(made) - 1))
    return code, said, misplaced(things(into), true.part(first, last, T))


def last_line(said: str) -> str:
    """The last line of what was said."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    return lines[-1] if lines else ""


def written(kind: Kind, shots: Sequence[Shot], scratch: Path) -> Path:
    """The kind's file or folder."""
    if kind.folder is not None:
        return kind.folder(shots, scratch)
    messages = record(shots)
    if kind.poses is not None:
        messages = kind.poses(shots)(messages)
    for change in kind.change:
        messages = change(messages)
    return kind.container(messages, scratch)


def trial(kind: Kind, true: Plain, scratch: Path) -> Outcome:
    """Write the kind, map it, and by its remedy where it is refused."""
    path = written(kind, true.shots, scratch)
    code, said, wrong = attempt(kind, path, (), true, scratch)
    told = re.search(kind.line, said) if kind.line else None
    if code == 0:
        line = next((x for x in said.splitlines() if told and re.search(kind.line, x)), "")
        if not wrong:
            return Outcome(kind.name, "right, with a line" if line else "right", line)
        verdict = "told" if line else "SILENTLY WRONG"
        return Outcome(kind.name, f"{verdict}: {wrong}", line)
    line = last_line(said)
    if "Traceback" in said or code != 1:
        return Outcome(kind.name, f"CRASH ({code})", line)
    if not told:
        return Outcome(kind.name, "REFUSED without the option", line)
    if kind.hopeless:
        return Outcome(kind.name, "refused, no option helps", line)
    groups = told.groups() if told else ()
    words = [word.format("", *groups, folder=true.folder) for word in kind.remedy]
    code, said, wrong = attempt(kind, path, words, true, scratch)
    option = " ".join(words).replace(f"{true.folder}/", "")
    if code or wrong:
        return Outcome(kind.name, f"OPTION FAILS: {wrong or last_line(said)}", line)
    return Outcome(kind.name, f"refused, works with {option}", line)
