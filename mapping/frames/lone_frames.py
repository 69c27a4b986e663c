"""Lone frames: a few side by side that contradict the frames before and after, which agree.

Depth is judged by the poses, and colour by both. Frames of another moment, camera, unit or pose are
found this way. They can be told only once the frame after them is there.
"""

from __future__ import annotations

import logging
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from perception.camera.depth_agreement import (
    Agreement,
    DepthSamples,
    agreement,
    colour_agreement,
    depth_samples,
    grey_samples,
    lone_text,
)
from perception.frames import Frame

Floats = NDArray[np.float64]

RUN: Final = 8  # frames that contradict the one before them and the one after them
MIN_POINTS: Final = 200  # fewest points in both images for a conclusion on depth
GOOD: Final = 0.85  # least share of agreeing points of two images of one scene
DOUBTED: Final = 0.8  # share of agreeing points of frames beside each other; sound ones have 0.94
USUAL: Final = 50  # last pairs, whose median agreement of colour is usual, ...
MIN_USUAL: Final = 8  # ... where there are so many
LESS: Final = 0.06  # than usual that colour agrees, and than of the frames around; sound ones 0.03
UNLIKE: Final = 0.35  # the same, of frames around that show little in common; sound ones 0.22
SOUND: Final = 2  # frames that agree as usual, after which such a run has ended
HELD: Final = 40  # frames that wait at most, as where the camera of the first gives no more

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A frame as it is compared."""

    id: str
    stamp: float
    T: Floats  # (4, 4) camera -> map
    samples: DepthSamples
    grey: NDArray[np.float32]  # on the grid of the samples

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """The view of a frame."""
        samples = depth_samples(frame.depth, frame.K)
        grey = grey_samples(frame.rgb, samples.depth.shape)
        return cls(frame.id, frame.stamp, frame.T_map_cam, samples, grey)


def agreement_of(a: View, b: View) -> Agreement:
    """Agreement of the depth of two views."""
    return agreement(a.samples, b.samples, np.linalg.inv(a.T) @ b.T)


def is_enough(found: Agreement) -> bool:
    """Whether two views show enough of one another for a conclusion."""
    return found.agreeing + found.contradicting >= MIN_POINTS


class DepthRuns:
    """Runs of frames whose depth contradicts the frames before and after."""

    def __init__(self) -> None:
        self.lone = list[str]()  # ids of those
        self.doubted = list[str]()  # ids of frames that may be so
        self.unexplained = ""  # id of the first of a longer run
        self._last: View | None = None
        self._before: View | None = None  # the last one before those that are doubted

    def add(self, view: View) -> None:
        """Compare a view with the one before it."""
        last, before = self._last, self._before
        self._last = view
        if last is None:
            return
        found = agreement_of(last, view)
        contradicts = is_enough(found) and found.share < DOUBTED
        if before is not None:
            around = agreement_of(before, view)
            if contradicts and around.share >= GOOD and is_enough(around):
                self._conclude(len(self.doubted))
            elif len(self.doubted) < RUN:
                self.doubted.append(view.id)
            else:
                self.finish()
        elif contradicts:
            self._before, self.doubted = last, [view.id]

    def finish(self) -> None:
        """Give up on those that no later frame explains."""
        self.unexplained = self.unexplained or "".join(self.doubted[:1])
        self._end()

    def _conclude(self, count: int) -> None:
        """Take the first of those that are doubted for lone."""
        self.lone += self.doubted[:count]
        self._end()

    def _end(self) -> None:
        self._before, self.doubted = None, []


class ColourRuns(DepthRuns):
    """Runs of frames whose colour contradicts the frames before and after.

    Where these show little in common, both ends of a run have to be unlike.
    """

    def __init__(self) -> None:
        super().__init__()
        self._usual = deque[float](maxlen=USUAL)
        self._begin = 0.0  # agreement of the first doubted frame with the one before
        self._until = 0  # doubted frames up to the last one that the next is unlike
        self._sound = 0  # frames since then

    def add(self, view: View) -> None:
        """Compare a view with the one before it."""
        last, before, self._last = self._last, self._before, view
        found = None if last is None else _colour(last, view)
        usual = float(np.median(self._usual)) if len(self._usual) >= MIN_USUAL else 0.0
        if low := found is not None and found < usual - LESS:
            self._sound = 0
        elif found is not None:
            self._usual.append(found)
            self._sound += 1
        if before is None:
            if low:
                self._before, self.doubted = last, [view.id]
                self._begin, self._until = found or 0.0, 0
            return
        within = False
        if low:
            off, around = max(self._begin, found or 0.0), _colour(before, view)
            within = around is not None and around >= off + LESS
            if within or off < usual - UNLIKE:
                self._until = len(self.doubted)
        if within or (self._until and self._sound >= SOUND):
            self._conclude(self._until)
        elif len(self.doubted) < RUN + SOUND:
            self.doubted.append(view.id)
        else:
            self._end()


def _colour(a: View, b: View) -> float | None:
    return colour_agreement(a.samples, a.grey, b.samples, b.grey, np.linalg.inv(a.T) @ b.T)


class LoneFrames:
    """The frames of a stream of one camera that are lone, by depth or by colour."""

    def __init__(self) -> None:
        self.depth, self.colour = DepthRuns(), ColourRuns()
        self._told = dict[str, int]()  # lone frames that were told, by kind of fault

    def add(self, view: View) -> dict[str, str]:
        """Judge a view, and those before it that are doubted.

        Returns a sentence by kind of fault, for people, as lone frames double.
        """
        self.depth.add(view)
        self.colour.add(view)
        found = {}
        for kind, what, runs in (("lone", "depth", self.depth), ("colour", "colour", self.colour)):
            ids = runs.lone
            if len(ids).bit_length() > self._told.get(kind, 0).bit_length():
                self._told[kind] = len(ids)
                count = f"{len(ids)} frame{'s' * (len(ids) > 1)}"
                found[kind] = lone_text(what, count, ids)
        return found

    def doubts(self, frame: str) -> bool:
        """Whether a frame, by its id, is doubted, which later ones may explain."""
        return frame in self.depth.doubted or frame in self.colour.doubted

    def has(self, frame: str) -> bool:
        """Whether a frame, by its id, is lone."""
        return frame in self.depth.lone or frame in self.colour.lone


def without_lone(
    frames: Iterable[Frame], name: str, lines: dict[tuple[str, str], str]
) -> Iterator[Frame]:
    """The frames of a stream, where lone ones show nothing; frames wait for those in doubt.

    A warning tells of them as they double; `lines` keeps the last by camera and kind of fault.
    """
    judges, held = defaultdict[str, LoneFrames](LoneFrames), deque[Frame]()

    def first() -> Frame:
        one = held.popleft()
        if not judges[one.camera].has(one.id):
            return one
        return replace(one, rgb=np.zeros_like(one.rgb), depth=np.full_like(one.depth, np.nan))

    try:
        for frame in frames:
            held.append(frame)
            for kind, line in judges[frame.camera].add(View.of(frame)).items():
                lines[frame.camera, kind] = f"{line}; they are left out"
                _log.warning("%s: %s", name, lines[frame.camera, kind])
            while held and (len(held) > HELD or not judges[held[0].camera].doubts(held[0].id)):
                yield first()
    except Exception:  # as of an unreadable frame, before which all count
        while held:
            yield first()
        raise
    while held:
        yield first()
