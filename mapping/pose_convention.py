"""Pose convention of a stream: whether its first motions are the ones that its depth shows.

Depth of two frames some motion apart agrees by camera-to-map poses of a camera that looks along
+z. Where it does not, but does with the poses inverted or the camera's axes exchanged
(`perception.camera.poses.CONVENTIONS`), that is what they are. A recording is checked in the same
way before it is mapped (`perception.sources.depth_check`).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from kg.model.errors import FrameError
from perception.camera.depth_agreement import Agreement, agreement, depth_samples
from perception.camera.poses import CONVENTIONS, motion
from perception.frames import Frame
from perception.sources.depth_check import FramePair, better_convention, median_share

APART: Final = (0.15, 1.0)  # [m] between the two frames of a pair: one that tells, and the most
TURNED: Final = (np.radians(6.0), np.radians(35.0))
OVERLAP: Final = 0.3  # share of a pair's points that both frames show by the poses as given
STILL: Final = 0.8  # share by no motion at all, from which a pair tells nothing
SOUND: Final = 0.85  # share of agreeing points that clears the poses as given
EXPLAINED: Final = 0.95  # share by another convention that refuses them; right ones reach 0.98
ENOUGH: Final = 8  # pairs that clear sound poses
MAX_PAIRS: Final = 24  # pairs, after which nothing is concluded any more
GIVEN: Final = "camera-to-world"


class PoseConventionCheck:
    """Compares frames of a stream that some motion separates, until its convention is known."""

    def __init__(self) -> None:
        self._anchor: Frame | None = None
        self._pairs = 0  # that were compared
        self._found = {name: list[Agreement]() for name in CONVENTIONS}
        self._done = False
        self._problem: str | None = None

    def check(self, frame: Frame) -> None:
        """Take in one frame.

        Raises FrameError once another convention explains the depth, and for each frame after it.
        """
        if not self._done and (pair := self._pair_with(frame)) is not None:
            self._conclude(pair, frame.id)
        if self._problem is not None:
            raise FrameError(self._problem)

    def _pair_with(self, frame: Frame) -> FramePair | None:
        """The frame and the one it is compared with; None: too little motion, or too much."""
        a, b = self._anchor or frame, frame
        distance, turn = motion(a.T_map_cam, b.T_map_cam)
        if a is not b and distance < APART[0] and turn < TURNED[0]:
            return None
        self._anchor = frame
        if a is b or distance > APART[1] or turn > TURNED[1]:
            return None
        samples = (depth_samples(a.depth, a.K), depth_samples(b.depth, b.K))
        return FramePair(*samples, (a.T_map_cam, b.T_map_cam))

    def _conclude(self, pair: FramePair, frame_id: str) -> None:
        self._pairs += 1
        still = agreement(pair.a, pair.b, np.eye(4))  # what moves with the camera tells nothing
        if still.share < STILL and pair.share(GIVEN, 1.0).overlap >= OVERLAP:
            for name, found in self._found.items():
                found.append(pair.share(name, 1.0))
        share = median_share(self._found[GIVEN])
        better = better_convention(self._found, GIVEN, EXPLAINED)
        if share is not None and better is not None:
            self._problem = _problem(frame_id, *better)
        sound = len(self._found[GIVEN]) >= ENOUGH and share is not None and share >= SOUND
        if self._problem is not None or sound or self._pairs >= MAX_PAIRS:
            self._done, self._anchor = True, None


def _problem(frame_id: str, given: float, best: float, name: str) -> str:
    return (
        f"frame {frame_id}: depth does not fit T_map_cam as camera-to-map poses ({given:.0%} of "
        f"the points that two frames share agree), but does ({best:.0%}) if they are {name} poses: "
        f'CONVENTIONS["{name}"](T_map_cam) of perception.camera.poses would work, in a new map; '
        "check_poses=False (--no-check) takes them as they are"
    )
