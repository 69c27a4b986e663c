"""Things without a name: how many are found in real rooms and in simulated houses.

    python -m benchmarks.things --cache DIR

Maps each recording and house once and keeps the maps in DIR. Each run looks for the things in all
frames anew, and drops those that the map's surface no longer shows. Prints Markdown: things to be
found, how many were, and clutter.

A thing to be found is 8 cm to 1 m long, stands free, has no sure name of COCO and is in no box of a
believed object. One that was found lies in the box of a thing of its own, which is at most 2.5
times as long. Clutter is near no entry of the truth, nor near what a person saw besides.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.command_line import run
from benchmarks.rooms.recordings import TRUTH, room_folders
from kg.maps.surface.voxels import Surface
from kg.model.areas import along
from kg.model.errors import RecordingError
from kg.model.records import ObjectRecord
from kg.serving.opening import create_map, open_map
from lab.houses.random_house import random_house
from lab.maps.complete_truth import load_complete_truth
from lab.recordings.object_truth import VisibilityRecord, object_truth
from mapping.surface.surface_mapper import SurfaceMapper
from mapping.things.thing_mapper import MIN_LENGTH, FoundThing, RecentViews, ThingFinder, is_covered
from mapping.things.view_parts import MAX_LENGTH
from perception.frames import Frame
from perception.sources.recording import open_recording
from planner.simulation.robot.house_robot import SimulatedTour
from planner.simulation.sensing.camera import SimulatedCamera

VOXEL: Final = 0.025  # [m]
IN_BOX: Final = 0.08  # [m] beside a box at which a position is in it, since truths are rough
TIMES: Final = 2.5  # times as long as the thing, its box at most, ...
MORE: Final = 0.05  # [m] ... and so much more
UNKNOWN: Final = 0.2  # [m] longest side of a thing whose truth has none
NEAR: Final = 0.1  # [m] beside a thing of the truth, where a box is no clutter
SEEN: Final = Path(__file__).with_suffix(".json")  # by eye: what stands free, and what is besides

NOBODY: Final = np.empty((0, 4), np.float32)  # boxes of people

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A thing that is there."""

    name: str
    p_map: Floats  # (3,) [m] its middle, or its front's
    extent: Floats  # (3,) [m] its sides; in real rooms the longest in each direction
    sought: bool  # whether it is to be found


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Frames, the map that was made of them, and what is there."""

    name: str
    frames: Iterable[Frame]
    surface: Surface
    named: tuple[ObjectRecord, ...]  # believed objects of the map
    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Things found in a scene."""

    scene: str
    sought: int
    found: dict[str, FoundThing]  # by the entry's name
    missed: tuple[str, ...]
    clutter: tuple[FoundThing, ...]
    all: int  # things in the map
    seconds: float  # [s] of a core


def room(folder: Path, cache: Path) -> Scene:
    """A recording's scene, mapped if its map is not in `cache`."""
    path = cache / f"{folder.name}.map"
    if not path.exists():
        words = [sys.executable, "-m", "hereabouts.cli", "map", str(folder), "--into", str(path)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    with open_map(path, read_only=True) as semantic_map:
        surface, named = semantic_map.surface(), semantic_map.objects(min_existence=0.5)
    recording = open_recording(folder)
    T = recording.T_map_world
    seen = json.loads(SEEN.read_text()).get(folder.name, {})
    entries = list[Entry]()
    for one in load_complete_truth(folder / TRUTH):
        p_map = T[:3, :3] @ one.p_world + T[:3, 3]
        sought = one.name in seen.get("free", ()) and not _is_in(p_map, named)
        longest = max(one.extent, default=UNKNOWN)
        if longest <= MAX_LENGTH + NEAR:
            entries.append(Entry(one.name, p_map, np.full(3, longest), sought))
    for name, x, y, z, longest in seen.get("besides", ()):
        entries.append(Entry(name, np.array([x, y, z]), np.full(3, longest), sought=False))
    return Scene(folder.name, recording.frames(), surface, named, tuple(entries))


def house(seed: int, cache: Path) -> Scene:
    """A simulated house's scene without a detector, mapped if its map is not in `cache`."""
    path, truth = cache / f"house-{seed}.map", cache / f"house-{seed}.json"
    if not truth.exists():
        truth.write_text(json.dumps(_mapped_house(seed, path)))
    with open_map(path, read_only=True) as semantic_map:
        surface = semantic_map.surface()
    entries = list[Entry]()
    for name, one in json.loads(truth.read_text())["objects"].items():
        longest, furnishing = max(one["extent"]), "what" in one
        if longest <= MAX_LENGTH or not furnishing:
            sought = not one["ignore"] and MIN_LENGTH <= longest <= MAX_LENGTH
            extent = np.array(one["extent"])
            entries.append(Entry(name, np.array(one["position"]), extent, sought))
    camera = SimulatedCamera(random_house(seed), seed=seed)
    frames = SimulatedTour(camera).frames()
    return Scene(f"house {seed}", frames, surface, (), tuple(entries))


def _mapped_house(seed: int, path: Path) -> dict[str, Any]:
    camera = SimulatedCamera(random_house(seed), seed=seed)
    visible = VisibilityRecord(camera.house, camera.model)
    with create_map(path) as semantic_map:
        mapper = SurfaceMapper(semantic_map, VOXEL, "tour")
        for frame in SimulatedTour(camera).frames():
            visible.add(frame.id, camera.view(frame.T_map_cam, frame.stamp))
            mapper.add(frame, NOBODY)
            mapper.save(semantic_map.sequence)
            mapper.accept()
        mapper.finish()
    return object_truth(camera.house, visible.frames, [])


def _is_in(p_map: Floats, named: Sequence[ObjectRecord]) -> bool:
    """Whether a position is in the box of a believed object that is no table."""
    for record in named:
        if record.extent is None or record.extent.max() > MAX_LENGTH:
            continue
        relative = np.abs(along(p_map - record.p_map, record.yaw))
        if (relative <= record.extent / 2 + NEAR / 2).all():
            return True
    return False


def score(scene: Scene) -> Score:
    """Find the things of a scene, and compare them with what is there."""
    views, finder, seconds = RecentViews(pictures=False), ThingFinder(), 0.0
    for frame in scene.frames:
        before = time.process_time()
        if views.add(frame, NOBODY):
            finder.add(frame, NOBODY)
        seconds += time.process_time() - before
    before = time.process_time()
    found_things = finder.found(scene.surface)
    seconds += time.process_time() - before
    things = [one for one in found_things if not is_covered(one.points, scene.named)]
    pairs = list[tuple[float, int, int]]()
    near = np.zeros(len(things), np.bool_)
    for number, one in enumerate(things):
        for index, entry in enumerate(scene.entries):
            apart = entry.p_map - one.box.centre
            inside = (np.abs(along(apart, one.box.yaw)) <= one.box.extent / 2 + IN_BOX).all()
            near[number] |= inside or (np.abs(apart) <= entry.extent / 2 + NEAR).all()
            fits = one.box.extent.max() <= TIMES * entry.extent.max() + MORE
            if entry.sought and inside and fits:
                pairs.append((float(np.linalg.norm(apart)), number, index))
    found, taken = dict[str, FoundThing](), set[int]()
    for _, number, index in sorted(pairs):
        name = scene.entries[index].name
        if number not in taken and name not in found:
            found[name] = things[number]
            taken.add(number)
    sought = [entry.name for entry in scene.entries if entry.sought]
    clutter = tuple(one for one, beside in zip(things, near, strict=True) if not beside)
    missed = tuple(name for name in sought if name not in found)
    return Score(scene.name, len(sought), found, missed, clutter, len(things), seconds)


def _command(arguments: argparse.Namespace) -> int:
    cache: Path = arguments.cache
    cache.mkdir(parents=True, exist_ok=True)
    folders = room_folders()
    if unknown := [name for name in arguments.rooms or () if name not in folders]:
        raise RecordingError(f"no room {unknown[0]!r}; there are: {', '.join(folders)}")
    rooms = list(folders) if arguments.rooms is None else arguments.rooms
    scores = [score(room(folders[name], cache)) for name in rooms]
    scores += [score(house(seed, cache)) for seed in arguments.seeds]
    lines = [
        "| | to be found | found | in the map | clutter | s of a core |",
        "|---|---|---|---|---|---|",
    ]
    for one in scores:
        recall = f"{len(one.found)} ({len(one.found) / one.sought:.0%})" if one.sought else "0"
        share = f"{len(one.clutter)} ({len(one.clutter) / one.all:.0%})" if one.all else "0"
        lines.append(
            f"| {one.scene} | {one.sought} | {recall} | {one.all} | {share} | {one.seconds:.2f} |"
        )
    for one in scores if arguments.verbose else ():
        lines += ["", f"{one.scene}: missed {', '.join(one.missed) or 'none'}", ""]
        lines += [
            f"- clutter at {np.round(thing.box.centre, 2).tolist()}, "
            f"{np.round(thing.box.extent, 2).tolist()} m, {thing.views} views"
            for thing in one.clutter
        ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Map where needed, find the things, print the table."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.things", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--cache", type=Path, metavar="DIR", required=True, help="keeps the maps")
    parser.add_argument("--rooms", nargs="*", metavar="NAME", help="recordings (default: all)")
    parser.add_argument("--seeds", type=int, nargs="*", default=[11, 12], help="houses")
    parser.add_argument("--verbose", action="store_true", help="names what is missed, and clutter")
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())
