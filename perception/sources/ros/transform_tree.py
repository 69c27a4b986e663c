"""Tree of coordinate frames over time, as tf2 has it.

Transforms between two stamps are interpolated (linear, and spherical for the rotation); static ones
hold for all times. So do those of `odom` in its parent, where odometry moves the camera below it:
they correct a drift (REP 105), and some localisations send them seldom, or once.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from kg.model.errors import RecordingError, did_you_mean
from perception.camera.poses import (
    Pose,
    check_pose_numbers,
    quaternion_from_pose,
)
from perception.sources.ros.image_messages import frame_name, nanoseconds
from perception.sources.ros.transform_link import MAX_GAP, Link

MAX_LINKS: Final = 10_000  # in a tree
MAX_DEPTH: Final = 100  # links between a frame and its root
MAX_TRANSFORMS: Final = 1_000  # in a message
MAP_FRAMES: Final = ("map", "world", "odom")  # the parents that lead to them are preferred
CORRECTED: Final = "odom"  # frame whose transform in its parent corrects odometry


def pose_numbers(position: Any, orientation: Any) -> tuple[float, ...]:
    """x y z [m] and the quaternion x y z w of the two halves of a pose or transform message."""
    t, q = position, orientation
    return tuple(float(n) for n in (t.x, t.y, t.z, q.x, q.y, q.z, q.w))


class TransformTree:
    """Links of frames to their parents, each a static transform or one over time.

    With `kept` a link keeps that many transforms at most, the latest ones. Where stamps jump back,
    as at the restart of a simulation, it forgets all earlier ones. There are MAX_LINKS links, and
    MAX_DEPTH of them between two frames, at most.
    """

    def __init__(self, kept: int | None = None) -> None:
        self._kept, self._count = kept, 0
        self._links: dict[str, dict[str, Link]] = {}  # child -> parent -> link
        self._preferred: dict[str, str] = {}

    def add_message(self, message: Any, *, static: bool) -> list[str]:
        """Add the transforms of a tf2_msgs/TFMessage; returns a message for each invalid one."""
        if len(message.transforms) > MAX_TRANSFORMS:
            found = len(message.transforms)
            return [f"a message has {found:,} transforms; up to {MAX_TRANSFORMS:,} would work"]
        refused = []
        for one in message.transforms:
            numbers = pose_numbers(one.transform.translation, one.transform.rotation)
            stamp = nanoseconds(one.header)
            try:
                self.add(one.header.frame_id, one.child_frame_id, stamp, numbers, static=static)
            except RecordingError as error:
                refused.append(str(error))
        return refused

    def add(
        self, parent: str, child: str, stamp: int, numbers: Sequence[float], *, static: bool = False
    ) -> None:
        """Add the pose of `child` in `parent` at `stamp` [ns]; `numbers` as of `pose_numbers`.

        Raises RecordingError for what is no pose.
        """
        parent, child = frame_name(parent), frame_name(child)
        where = f"transform {parent} -> {child}"
        if parent == child or not parent or not child:
            raise RecordingError(f"{where}: a link needs two frames")
        check_pose_numbers(numbers, where)
        if parent not in self._links.get(child, ()):
            if self._count >= MAX_LINKS:
                raise RecordingError(f"{where}: there are {MAX_LINKS} other links already")
            self._count += 1
        link = self._links.setdefault(child, {}).setdefault(parent, Link())
        link.forget(stamp, self._kept)
        link.add(stamp, numbers, static)

    def prefer(self, parent: str, child: str) -> None:
        """Set `parent` as the parent of `child`, whatever other links there are."""
        self._preferred[frame_name(child)] = frame_name(parent)

    def link(self, parent: str, child: str, T: Pose) -> None:
        """Add a static link by the pose (4, 4) of `child` in `parent`, and prefer it."""
        numbers = (*T[:3, 3], *quaternion_from_pose(T))
        self.add(parent, child, 0, [float(n) for n in numbers], static=True)
        self.prefer(parent, child)

    def keep_last_run(self) -> None:
        """Forget what came before stamps jumped back, as where a simulation is started again."""
        for links in self._links.values():
            for link in links.values():
                link.keep_last_run()

    def merged(self, other: TransformTree) -> TransformTree:
        """A tree with the links of both, which are shared with them."""
        both = TransformTree(self._kept)
        for tree in (other, self):
            for child, links in tree._links.items():
                both._links.setdefault(child, {}).update(links)
            both._preferred.update(tree._preferred)
        both._count = sum(map(len, both._links.values()))
        return both

    def mounts(self, frame: str) -> list[str]:
        """Frames above `frame` that static links join to it, the nearest first."""
        chain = self.ancestors(frame)
        still = [place for place, one in enumerate(chain[:-1]) if not self.is_static(one)]
        return chain[1 : still[0] + 1] if still else chain[1:]

    def chains(self) -> dict[str, list[str]]:
        """Each frame with those above it, without frames whose links form a loop."""
        found = {}
        for frame in self.frames:
            with contextlib.suppress(RecordingError):
                found[frame] = self.ancestors(frame)
        return found

    def carried(self) -> list[str]:
        """Frames that a link above them moves."""
        return [
            frame
            for frame, chain in self.chains().items()
            if any(not self.is_static(one) for one in chain[:-1])
        ]

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames, sorted."""
        return tuple(sorted({*self._links, *(p for links in self._links.values() for p in links)}))

    def parent(self, child: str) -> str | None:
        """Parent of a frame, None of a root.

        Of several, the one that map, world or odom is above of, in this order; then the one with
        the most transforms. A moving one that was told once counts last.
        """
        links = self._links.get(frame_name(child))
        if not links:
            return None
        preferred = self._preferred.get(frame_name(child))
        if preferred in links:
            return preferred
        if len(links) == 1:
            return next(iter(links))
        return max(
            links,
            key=lambda p: (
                links[p].static or len(links[p]) > 1,
                -self._map_frame_above(p),
                len(links[p]),
                p,
            ),
        )

    def _map_frame_above(self, frame: str) -> int:
        """Index of the first of MAP_FRAMES that a frame is or is below of, by any parents."""
        above = {one.rpartition("/")[2] for one in self._all_above(frame)}
        return next((i for i, name in enumerate(MAP_FRAMES) if name in above), len(MAP_FRAMES))

    def _all_above(self, frame: str) -> dict[str, str]:
        """`frame` and all frames above it by any parents, each with the one below it."""
        found, left = {frame: ""}, [frame]
        while left:
            child = left.pop()
            for parent in self._links.get(child, ()):
                if parent not in found:
                    found[parent] = child
                    left.append(parent)
        return found

    def lead(self, child: str, target: str) -> None:
        """Prefer the parents by which `target` is above `child`, where any are."""
        below, target = self._all_above(frame_name(child)), frame_name(target)
        while below.get(target):
            self.prefer(target, below[target])
            target = below[target]

    def other_parents(self, chain: Sequence[str]) -> list[tuple[str, str, list[str]]]:
        """Frames of a chain with their parent in it, where they have others, and these."""
        links = [(child, self.parent(child), self._links.get(child, {})) for child in chain]
        return [
            (child, parent, sorted(one for one in parents if one != parent))
            for child, parent, parents in links
            if parent is not None and len(parents) > 1
        ]

    def contradiction(self, child: str, begin: float = -np.inf) -> tuple[float, float]:
        """Distance [m] and angle [rad] between what two publishers tell of a frame in its parent.

        Both 0 for one publisher. Static transforms contradict each other where they are of one
        stamp, or of stamps up to `begin` [s].
        """
        none = 0.0, 0.0
        return none if self.parent(child) is None else self._link(child).contradiction(begin)

    def is_static(self, child: str) -> bool:
        """Whether the link of `child` to its parent is static."""
        parent = self.parent(child)
        return parent is not None and self._links[child][parent].static

    def ancestors(self, frame: str) -> list[str]:
        """`frame`, its parent and so on up to the root.

        Raises RecordingError where the links form a loop, or a chain of more than MAX_DEPTH.
        """
        chain = [frame_name(frame)]
        while (parent := self.parent(chain[-1])) is not None:
            if len(chain) > MAX_DEPTH:
                raise RecordingError(
                    f"more than {MAX_DEPTH} transforms lead from {chain[0]!r} to its root"
                )
            if parent in chain:
                loop = " -> ".join([*chain[chain.index(parent) :], parent])
                raise RecordingError(f"transforms form a loop: {loop}")
            chain.append(parent)
        return chain

    def at(self, target: str, source: str, stamp: float) -> Pose | None:
        """Transform (4, 4) of `source` to `target` coordinates at `stamp` [s].

        None where a link on the way has no transform about that time. Raises RecordingError where
        no links join the two, or links form a loop.
        """
        up, down = self.ancestors(source), self.ancestors(target)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise RecordingError(self._apart(target, source, down, up))
        T_common_source = self._chain(up[: up.index(common)], stamp)
        T_common_target = self._chain(down[: down.index(common)], stamp)
        if T_common_source is None or T_common_target is None:
            return None
        if len(down) and down[0] == common:
            return T_common_source
        T: Pose = np.linalg.inv(T_common_target) @ T_common_source
        return T

    def span(self, target: str, source: str) -> tuple[float, float] | None:
        """First and last stamp [s] that all moving links between two frames cover; None: static."""
        moving = [link.trajectory().stamp for link in self._moving(target, source).values()]
        if not moving:
            return None
        return float(max(s[0] for s in moving)), float(min(s[-1] for s in moving))

    def last_link(self, target: str, source: str) -> tuple[str, str, float] | None:
        """Parent, child and last stamp [s] of the moving link that ends first; None: all static.

        Raises RecordingError where no transforms link the two frames.
        """
        up, down = self.ancestors(source), self.ancestors(target)
        if up[-1] != down[-1]:
            raise RecordingError(self._apart(target, source, down, up))
        ends = [
            (float(link.trajectory().stamp[-1]), child)
            for child, link in self._moving(target, source).items()
        ]
        if not ends:
            return None
        stamp, child = min(ends)
        return self.parent(child) or "", child, stamp

    def _moving(self, target: str, source: str) -> dict[str, Link]:
        """The moving links between two frames, by their children."""
        up, down = self.ancestors(source), self.ancestors(target)
        links = {
            frame: self._link(frame) for frame in {*up} ^ {*down} if self.parent(frame) is not None
        }
        return {frame: link for frame, link in links.items() if not link.static}

    def _link(self, child: str) -> Link:
        parent = self.parent(child)
        assert parent is not None
        return self._links[child][parent]

    def _chain(self, children: list[str], stamp: float) -> Pose | None:
        """Transform (4, 4) of the first of `children` to the last one's parent."""
        T: Pose | None = None
        moving = [child for child in children if not self._link(child).static]
        for child in reversed(children):
            step = self._link(child).at(stamp)
            if step is None and _is_odom(child) and child != moving[0]:
                step = self._link(child).held(stamp, 0.0 if self._kept is None else MAX_GAP)
            if step is None:
                return None
            T = step if T is None else T @ step
        return np.eye(4) if T is None else T

    def _apart(self, target: str, source: str, down: list[str], up: list[str]) -> str:
        for frame in (target, source):
            if frame_name(frame) not in self.frames:
                known = ", ".join(self.frames[:20]) or "none"
                close = did_you_mean(frame_name(frame), self.frames)
                return f"no transforms of frame {frame!r}{close}; there are: {known}"
        return (
            f"no transforms link {source!r} (in the tree of {up[-1]!r}) to {target!r} (in the "
            f"tree of {down[-1]!r})"
        )


def _is_odom(frame: str) -> bool:
    """Whether a frame is that of odometry, of any robot."""
    return frame.rpartition("/")[2] == CORRECTED
