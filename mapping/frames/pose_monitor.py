"""Pose monitor: detects jumps and drift of a stream's poses by its depth images.

Jump: the depth of two consecutive frames of one scene shows another motion than their poses do.
Step: depth contradicts the frames before, and no later frame shows which of them are right.
Lone, colour: depth or colour of a few frames contradicts those before and after (`lone_frames`).
Order: red and blue seem to be exchanged.
Constant: a depth that many pixels share stays the same while the camera moves.
Drift: where the camera returns to a place, the depth of two key frames agrees only after one of
them is moved by some decimetres.
"""

from __future__ import annotations

import logging
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.frames.lone_frames import GOOD, LoneFrames, View, agreement_of, is_enough
from perception.camera.channel_order import ChannelOrder
from perception.camera.depth_agreement import Agreement, register
from perception.camera.poses import rotation_angle
from perception.frames import Frame
from perception.no_return import UnmovedValues, told

Floats = NDArray[np.float64]

STEP: Final = 0.1  # [m] between two frames, or ...
STEP_TURN: Final = np.radians(5.0)  # ... so much turned, that may be a jump
JUMP: Final = 0.15  # [m] by which the depth must show another motion, or ...
JUMP_TURN: Final = np.radians(8.0)  # ... turn
POOR: Final = 0.7  # share of agreeing points that is a contradiction
KEY_STEP: Final = 0.4  # [m] between key frames, or ...
KEY_TURN: Final = np.radians(20.0)  # ... so much turned
KEPT: Final = 300  # key frames
AWAY: Final = 8  # key frames between two views of one place
NEAR: Final = 1.0  # [m] between the cameras of two such views ...
NEAR_TURN: Final = np.radians(30.0)
DRIFT: Final = 0.15  # [m] tolerated distance of surfaces
TIMES: Final = 2  # number of such views before the monitor warns, ...
RETURNS: Final = 20  # ... of so many views of former places: in a day some change their place
_MEND: Final = "a corrected trajectory, --poses FILE, would work"

_log = logging.getLogger(__name__)


class PoseMonitor:
    """Compares each frame with the one before, and key frames with earlier views of their place.

    `problems` has what was found, one line for each kind; each is logged as a warning.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._last: View | None = None
        self._lone = LoneFrames()
        self._motion = np.eye(4)
        self._keys = list[View]()
        self._unmoved, self._order = UnmovedValues(), ChannelOrder()
        self._off = deque[bool](maxlen=RETURNS)  # whether surfaces were off, of the last returns
        self.problems = dict[str, str]()

    def add(self, frame: Frame) -> None:
        """Check one frame."""
        view = View.of(frame)
        for kind, line in self._lone.add(view).items():
            self._tell(kind, f"{line}; a copy without them would work")
        self._tell_step()
        if "constant" not in self.problems:
            self._check_constant(frame)
        last, self._last = self._last, view
        if last is not None:
            motion = np.linalg.inv(last.T) @ view.T
            moved = "jump" not in self.problems and _moved(motion, STEP, STEP_TURN)
            if moved and _contradicts(agreement_of(last, view)):
                self._check_jump(last, view, motion)
            self._motion = motion
        if self._is_key(view):
            self._check_order(frame)
            self._check_drift(view)

    def _check_constant(self, frame: Frame) -> None:
        """Look for a depth that many pixels share and that does not change as the camera moves."""
        self._unmoved.add(frame.depth, frame.K, frame.T_map_cam)
        if found := self._unmoved.found:
            self._tell(
                "constant",
                f"depth of {told(found)} stays the same while the camera moves, up to frame "
                f"{frame.id}: it seems to mean no return; nan in its place would work",
            )

    def _tell_step(self) -> None:
        """Tell of frames that contradict those before, where none after shows which are right."""
        if (first := self._lone.depth.unexplained) and not {"step", "jump"} & {*self.problems}:
            self._tell(
                "step",
                f"from frame {first} on depth contradicts the poses or the depth before, and no "
                f"later frame tells which is right; {_MEND} where the poses are off",
            )

    def finish(self) -> None:
        """Tell what no later frame explains."""
        self._lone.depth.finish()
        self._tell_step()

    def _check_jump(self, last: View, view: View, motion: Floats) -> None:
        """Look for another motion than that of the poses, which the depth contradicts."""
        a, b = last.samples, view.samples
        for start in (np.eye(4), self._motion, motion):
            found = register(a, b, start)
            off = np.linalg.inv(found.T_a_b) @ motion
            if found.after.share >= GOOD and _moved(off, JUMP, JUMP_TURN):
                self._keys.clear()  # the jump moved the earlier key frames
                self._tell(
                    "jump",
                    f"the poses jump at frame {view.id} by {np.linalg.norm(off[:3, 3]):.2f} m and "
                    f"{np.degrees(_turn(off)):.0f} degrees, which the depth does not show; {_MEND}",
                )
                return

    def _is_key(self, view: View) -> bool:
        return not self._keys or _moved(
            np.linalg.inv(self._keys[-1].T) @ view.T, KEY_STEP, KEY_TURN
        )

    def _check_order(self, frame: Frame) -> None:
        """Look for red and blue that are exchanged."""
        if "order" not in self.problems:
            self._order.add(frame.rgb)
            if line := self._order.told:
                self._tell("order", line)

    def _check_drift(self, key: View) -> None:
        samples, before = key.samples, self._seen_before(key)
        self._keys = [*self._keys[-KEPT + 1 :], key]
        if before is None or "drift" in self.problems:
            return
        motion = np.linalg.inv(before.T) @ key.T
        self._off.append(False)
        if not _contradicts(agreement_of(before, key)):
            return
        found = register(before.samples, samples, motion)
        if found.after.share < GOOD or found.offset < DRIFT:
            return
        self._off[-1] = True
        if sum(self._off) >= TIMES:
            self._tell(
                "drift",
                f"the poses drift: at frame {key.id} surfaces lie {found.offset:.2f} m from where "
                f"frame {before.id} saw them, {key.stamp - before.stamp:.0f} s before; {_MEND}",
            )

    def _seen_before(self, key: View) -> View | None:
        """The earlier key frame of the most similar view, some way back; None without any."""
        earlier = self._keys[:-AWAY]
        if not earlier:
            return None
        T = np.array([other.T for other in earlier])
        distance = np.linalg.norm(T[:, :3, 3] - key.T[:3, 3], axis=1)
        cosine = (np.einsum("nij,ij->n", T[:, :3, :3], key.T[:3, :3]) - 1) / 2
        turn = np.arccos(np.clip(cosine, -1, 1))
        apart = np.where((distance <= NEAR) & (turn <= NEAR_TURN), distance + turn, np.inf)
        nearest = int(apart.argmin())
        return earlier[nearest] if np.isfinite(apart[nearest]) else None

    def _tell(self, kind: str, problem: str) -> None:
        self.problems[kind] = problem
        _log.warning("%s: %s", self._name, self.problems[kind])


class PoseMonitors:
    """A monitor for each camera of a stream."""

    def __init__(self, name: str) -> None:
        self._name, self._monitors = name, dict[str, PoseMonitor]()

    def add(self, frame: Frame) -> None:
        """Check one frame."""
        if frame.camera not in self._monitors:
            name = f"{self._name}, camera {frame.camera}" if frame.camera else self._name
            self._monitors[frame.camera] = PoseMonitor(name)
        self._monitors[frame.camera].add(frame)

    def finish(self) -> None:
        """Tell what no later frame explains."""
        for one in self._monitors.values():
            one.finish()

    @property
    def problems(self) -> tuple[str, ...]:
        """Lines on wrong poses, one for each kind of fault."""
        return tuple(line for one in self._monitors.values() for line in one.problems.values())


def _contradicts(found: Agreement) -> bool:
    """Whether two images show different scenes although they have nearly the same pose."""
    return found.share < POOR and is_enough(found)


def _turn(T: Floats) -> float:
    return rotation_angle(T[:3, :3])


def _moved(T: Floats, distance: float, turn: float) -> bool:
    return float(np.linalg.norm(T[:3, 3])) > distance or _turn(T) > turn
