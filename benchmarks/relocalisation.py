"""Recordings without poses that find themselves in a map: errors against truth, and refusals.

Parts of each recording are placed by the key views of another part, which has true poses or
estimated ones; then the parts of one recording by those of each other one, which is wrong.

python -m benchmarks.relocalisation ../shared/data/rgbd/{redkitchen,icl_livingroom,hololens_lounge}
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from perception.camera.gravity_alignment import gravity_aligned_transform
from perception.camera.poses import BODY_FROM_CAMERA, Pose, motion
from perception.frames import Frame
from perception.odometry.features import FeatureDetector
from perception.odometry.recognition import Doubt, KeyView, Recogniser, decoded, encoded, view_of
from perception.odometry.spread_poses import is_new
from perception.odometry.tracking import tracked
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

PARTS = {
    "halves": lambda n, count: n < count // 2,
    "halves, backwards": lambda n, count: n >= count // 2,
    "thirds, first and last": lambda n, count: (
        None if count / 3 < n < 2 * count / 3 else n < count / 2
    ),
    "every other stretch of 20": lambda n, count: n // 20 % 2 == 0,
    "every other frame": lambda n, count: n % 2 == 0,
}


@dataclass(frozen=True)
class Part:
    """Frames by true or estimated poses, and the true ones."""

    name: str
    frames: list[Frame]
    true: dict[str, Pose]

    @property
    def T_map_true(self) -> Pose:  # noqa: N802 - names its frames
        """Where the true world is in that of the frames, by the first frame."""
        first = self.frames[0]
        T: Pose = first.T_map_cam @ np.linalg.inv(self.true[first.id])
        return T


@dataclass(frozen=True)
class _Taken:
    frames_: Sequence[Frame]
    name: str = "part"
    T_map_world = np.eye(4)

    def __len__(self) -> int:
        return len(self.frames_)

    def frames(self, start: int = 0) -> Sequence[Frame]:
        return iter(self.frames_[start:])  # type: ignore[return-value]


def given(name: str, frames: list[Frame]) -> Part:
    """A part by its true poses."""
    return Part(name, frames, {frame.id: frame.T_map_cam for frame in frames})


def estimated(part: Part) -> Part:
    """The same frames by poses that their images give, in a levelled world of their own."""
    poses = tracked(lambda: part.frames).poses()
    found = [
        replace(frame, T_map_cam=BODY_FROM_CAMERA @ T)
        for frame, T in zip(part.frames, poses, strict=True)
        if T is not None
    ]
    up = gravity_aligned_transform(_Taken(found))
    return replace(part, frames=[replace(f, T_map_cam=up @ f.T_map_cam) for f in found])


def views_of(part: Part) -> list[tuple[KeyView, Frame]]:
    """Views of the frames that are apart, as a map keeps them."""
    detector, poses, views = FeatureDetector(), list[Pose](), []
    for frame in part.frames:
        if is_new(frame.T_map_cam, poses):
            poses.append(frame.T_map_cam)
            view = view_of(frame, detector)[0]
            views.append((decoded(encoded(view), view.pose), frame))
    return views


def row(held: Part, other: Part, *, same: bool) -> str:
    """One line: where `other` was found in a map of `held`."""
    before = time.process_time()
    views = views_of(held)
    detector, recogniser = FeatureDetector(), Recogniser([view for view, _ in views])
    for _, frame in views_of(other):
        recogniser.look(*view_of(frame, detector))
    found, seconds = recogniser.result(), time.process_time() - before
    counts = f"{len(views):3d} views, {len(recogniser.images):3d} compared, {seconds:4.1f} s"
    if isinstance(found, Doubt):
        return f"{counts}  refused: {found.reason}"
    errors = [
        motion(held.T_map_true @ other.true[frame.id], found.T @ frame.T_map_cam)
        for frame in other.frames
    ]
    far, turned = (np.array(column) for column in zip(*errors, strict=True))
    return (
        f"{counts}  {len(found.matches)} matches, said to be within {found.error:.2f} m: error "
        f"{np.sqrt((far**2).mean()):.3f} m (max {far.max():.3f}), "
        f"{np.degrees(np.sqrt((turned**2).mean())):.1f} degrees" + ("" if same else "  WRONG ROOM")
    )


def main() -> None:
    """Print a line for each pair of parts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recordings", nargs="+", metavar="RECORDING", help="with true poses")
    parser.add_argument("--estimated", action="store_true", help="poses of the map's part, too")
    arguments = parser.parse_args()
    rooms = []
    for path in arguments.recordings:
        recording = open_recording(path, RecordingOptions(check=False))
        rooms.append(given(recording.name, list(recording.frames())))
    for room in rooms:
        count = len(room.frames)
        for name, first in PARTS.items():
            held, other = (
                given(room.name, [f for n, f in enumerate(room.frames) if first(n, count) is side])
                for side in (True, False)
            )
            other = estimated(other)
            share = f"{len(other.frames)}/{len(other.true)} tracked"
            held = estimated(held) if arguments.estimated else held
            print(f"{room.name:16} {name:26} {share}  {row(held, other, same=True)}", flush=True)  # noqa: T201
    for one, other in permutations(rooms, 2):
        print(f"{other.name} in a map of {one.name}  {row(one, other, same=False)}", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
