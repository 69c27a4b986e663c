"""Things that moved between two halves of a recording: `python -m benchmarks.moved [ROOM ...]`.

A room with a complete truth is cut in two. After the first half, some of the map's small objects
are put elsewhere in the map, into air that the second half sees through, as if they had stood
there. The second half, a day later, so finds their spots empty and the things in other places. It
is mapped without and with pictures. Prints Markdown rows: pairs of things and objects as
`hereabouts evaluate map --sessions` counts them.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.rooms.recordings import TRUTH, detector_of, look, looks, networks, room_folders
from benchmarks.rooms.stretches import matcher_of
from hereabouts.cli.arguments import count
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import create_map, open_map
from lab.command_line import run
from lab.maps.complete_truth import load_complete_truth
from lab.maps.map_evaluation import evaluate_map
from lab.maps.session_identity import Session, SessionIdentity, pooled_identity, session_identity
from lab.maps.truth_matching import TruthMatcher
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.frames import Detections, Frame
from perception.sources.recording import open_recording

HEADER: Final = (
    "| room | pictures | things | number | right | wrong | F1 |\n|---|---|---|---|---|---|---|"
)
SMALL: Final = 0.6  # [m] longest side of the things that move, half of them in each draw
DAY: Final = 86_400.0  # [s] between the halves
_THRESHOLD: Final = 0.2
_FREE: Final = 0.3  # [m] of air behind a spot that is seen through
_VIEWS: Final = 6  # frames that see through a spot
_FAR: Final = 0.8  # [m] from the thing's own place

Floats = NDArray[np.float64]
Seen = tuple[Frame, Detections]


class Room:
    """A recording with a complete truth, cut in two, with what the bundled detectors saw."""

    def __init__(self, folder: Path, cache: Path) -> None:
        self.name, recording = folder.name, open_recording(folder)
        pair = networks()["default"]
        look(folder, pair, cache)
        detector = detector_of(looks(folder, pair, cache), _THRESHOLD)
        self.T_map_world = recording.T_map_world
        self.truth = load_complete_truth(folder / TRUTH)
        seen = [(frame, detector.detect(frame)) for frame in recording.frames()]
        self.first = seen[: len(seen) // 2]
        later = seen[len(seen) // 2 :]
        self.second = [(replace(f, stamp=f.stamp + DAY), found) for f, found in later]

    def matcher(self, seen: Sequence[Seen], moved: frozenset[str] = frozenset()) -> TruthMatcher:
        """The truth of one half, in which the things `moved` count as such."""
        truth = [replace(one, moved=one.name in moved) for one in self.truth]
        return matcher_of([frame for frame, _ in seen], truth, self.T_map_world)


def mapped(semantic_map: SemanticMap, name: str, seen: Sequence[Seen], *, pictures: bool) -> None:
    """Map one half of a room."""
    options = MappingOptions(occupancy=False, things=False, pictures=pictures)
    with Mapper(semantic_map, options, recording=name) as mapper:
        for frame, detections in seen:
            mapper.add(frame, detections)


def session(semantic_map: SemanticMap, matcher: TruthMatcher) -> Session:
    """The map as it is, matched to a truth."""
    return evaluate_map(semantic_map, matcher, semantic_map.sequence).shown, matcher


def displaced(
    semantic_map: SemanticMap, before: Session, room: Room, random: np.random.Generator
) -> frozenset[str]:
    """Put some of the objects that both halves show elsewhere; returns the things' names."""
    matching, matcher = before
    shown = {one.name for one in room.matcher(room.second).truth if not one.ignore}
    things = {matching.mapped[p.mapped].iri: matcher.truth[p.true].name for p in matching.matched}
    both = [iri for iri, name in things.items() if name in shown]
    small = [one for one in semantic_map.perceived.objects(tuple(both)) if _is_small(one)]
    small.sort(key=lambda one: one.iri)
    chosen = random.permutation(len(small))[: max(len(small) // 2, 1)]
    records = [small[int(row)] for row in chosen]
    frames = [frame for frame, _ in room.second]
    placed = [replace(one, p_map=_free_spot(frames, one.p_map, random)) for one in records]
    semantic_map.apply(MapUpdate(tuple(placed)))
    return frozenset(things[one.iri] for one in records)


def _is_small(record: ObjectRecord) -> bool:
    return record.extent is not None and float(record.extent.max()) <= SMALL


def _free_spot(frames: Sequence[Frame], p_map: Floats, random: np.random.Generator) -> Floats:
    """(3,) [m] a spot in air, away from `p_map`, that several frames see through."""
    while True:
        frame = frames[random.integers(len(frames))]
        row, column = (int(random.integers(size // 8, size * 7 // 8)) for size in frame.depth.shape)
        depth = float(frame.depth[row, column]) * random.uniform(0.5, 0.9)
        if not 0.8 < depth < 4.0:
            continue
        p_cam = np.linalg.solve(frame.K, np.array([column, row, 1.0])) * depth
        spot: Floats = frame.T_map_cam[:3, :3] @ p_cam + frame.T_map_cam[:3, 3]
        behind = np.array([_behind(one, spot) for one in frames])
        near = np.abs(behind) < _FREE
        far = np.linalg.norm(spot - p_map) > _FAR
        if far and not near.any() and (behind > _FREE).sum() >= _VIEWS:
            return spot


def _behind(frame: Frame, p_map: Floats) -> float:
    """How far behind a spot a frame sees a surface [m]; nan where it does not show the spot."""
    p_cam = frame.T_map_cam[:3, :3].T @ (p_map - frame.T_map_cam[:3, 3])
    if p_cam[2] < 0.5 or p_cam[2] > 4.5:
        return np.nan
    column, row = (frame.K @ p_cam / p_cam[2])[:2].astype(int)
    height, width = frame.depth.shape
    if not (8 <= row < height - 8 and 8 <= column < width - 8):
        return np.nan
    part = frame.depth[row - 4 : row + 5, column - 4 : column + 5]
    part = part[part > 0]
    return float(part.min() - p_cam[2]) if len(part) else np.nan


def identities(room: Room, draws: int) -> dict[bool, SessionIdentity]:
    """Identity of the things of a room over all draws, without and with pictures."""
    found: dict[bool, list[SessionIdentity]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as temporary:
        first = Path(temporary) / "first.map"
        with create_map(first, base="https://example.org/map/") as semantic_map:
            mapped(semantic_map, "first", room.first, pictures=True)
            before = session(semantic_map, room.matcher(room.first))
        for draw in range(draws):
            for pictures in found:
                folder = Path(temporary) / f"{draw}-{pictures}.map"
                shutil.copytree(first, folder)
                with open_map(folder) as semantic_map:
                    random = np.random.default_rng(draw)
                    moved = displaced(semantic_map, before, room, random)
                    mapped(semantic_map, "second", room.second, pictures=pictures)
                    after = session(semantic_map, room.matcher(room.second, moved))
                found[pictures].append(session_identity(before, after))
    return {pictures: pooled_identity(several) for pictures, several in found.items()}


def _command(arguments: argparse.Namespace) -> int:
    folders = room_folders()
    sys.stdout.write(HEADER + "\n")
    for name in arguments.rooms or folders:
        room = Room(folders[name], arguments.cache)
        for pictures, found in identities(room, arguments.draws).items():
            for kind, one in (("all", found.everything), ("moved", found.moved)):
                f1 = "" if one.f1 is None else f"{one.f1:.2f}"
                counts = f"{kind} | {one.things} | {one.right} | {one.wrong} | {f1}"
                sys.stdout.write(f"| {name} | {'yes' if pictures else 'no'} | {counts} |\n")
        sys.stdout.flush()
    return 0


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="redkitchen, ... (default: all)")
    parser.add_argument("--draws", type=count, default=4, help="of things that moved")
    parser.add_argument("--cache", type=Path, default=Path("build/looks"), help="what networks saw")
    return run(parser, _command)


if __name__ == "__main__":
    sys.exit(main())
