"""Where to look next, in terms of a robot's poses: a `Hunt` for what the robot does and meets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kg.errors import LayoutError
from kg.records import LookRecord, ObstacleRecord
from kg.semantic_map import SemanticMap
from planner.executive.protocol import Hello, RobotPose
from planner.finding.candidates import Candidate
from planner.finding.hunt import Hunt, prepare
from planner.finding.settings import BELIEF
from planner.viewing.sensor import Motion, Sensor, angle_between

NEAR: float = 0.5  # [m] a look from this near to a planned one, and ...
ALIKE: float = 0.35  # [rad] ... towards about the same, is that look
BLOCKS: float = 0.6  # [m] around an obstacle that cannot be driven through: this closes a door


@dataclass(frozen=True, slots=True)
class Proposal:
    """The next look: where to stand, how to turn, what it is expected to bring and why."""

    x: float  # [m]
    y: float
    heading: float  # [rad] to arrive with: the beginning of the sweep
    turn: float  # [rad] to sweep from there, to the left
    middle: float  # [rad] heading in the middle of what is seen
    extent: float  # [rad] seen in all
    place: str  # what people call the place, "" where it is none
    probability: float  # to find any of what is wanted
    seconds: float  # [s] until the look is over
    left: float  # probability that it is there to be found, if this look is in vain
    why: tuple[str, ...]  # the weightiest reasons first


class Guide:
    """Keeps a hunt in step with a robot. `prepare` begins, and begins afresh what was learnt."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        words: Sequence[str],
        robot: Hello,
        at: float,
        give_up_at: float = BELIEF.rest,
    ) -> None:
        self._map = semantic_map
        self._at = at  # [s] the moment that memories are judged from, the same in each run
        self._words = tuple(words)
        self._settings = replace(BELIEF, rest=give_up_at)
        self._sensor, self._motion = sensor_of(robot), motion_of(robot)
        self._hunt = self._prepared()
        self._nowhere = False  # whether no position is left to look from

    @property
    def left(self) -> float:
        """Probability that any of what is still wanted is there to be found."""
        return self._hunt.left

    @property
    def unsure(self) -> bool:
        """Whether a thing on this floor may still have been missed by more than is put up with."""
        return self._hunt.overlooked > self._settings.rest

    @property
    def field_of_view(self) -> float:
        """[rad] what one picture shows, across."""
        return self._sensor.field_of_view

    def next(self, pose: RobotPose) -> Proposal | None:
        """The look to take next; None where none is worth the way."""
        hunt = self._hunt
        if self._nowhere:
            return None
        at = hunt.standing((pose.x, pose.y), pose.heading)
        look = hunt.next(at)
        if look is None:
            return None
        looks = hunt.looks
        x, y = (float(c) for c in looks.space.centres([looks.stands[looks.stand[look]]])[0])
        way = math.hypot(x - pose.x, y - pose.y)
        came = math.atan2(y - pose.y, x - pose.x) if way > looks.space.cell else pose.heading
        heading, turn = self._sweep(look, came)
        gain = float(hunt.memory.chance(look) @ hunt.belief.weight)
        left = max(hunt.left - gain, 0.0) / max(1.0 - gain, 1e-9)
        return Proposal(
            x=x,
            y=y,
            heading=heading,
            turn=turn,
            middle=float(looks.heading[look]),
            extent=float(looks.extent[look]),
            place=hunt.place_name(look),
            probability=gain,
            seconds=float(hunt.tourist.costs(at, np.array([look]))[0]),
            left=left,
            why=tuple(_said(reason.candidate) for reason in hunt.why(look)[:3]),
        )

    def missed(self, pose: RobotPose, heading: float, extent: float) -> None:
        """Learn that a look showed nothing new of what is wanted."""
        look = self._look_like(pose, heading, extent)
        if look is not None:
            self._hunt.missed(look)
            return
        for towards in self._pictures(heading, extent):
            self.glimpsed(pose.x, pose.y, towards)

    def glimpsed(self, x: float, y: float, heading: float) -> None:
        """Learn that one picture showed nothing of what is wanted."""
        self._hunt.missed_picture(self._hunt.space.nearest((x, y)), heading)

    def found(self, target: str, p_map: np.ndarray) -> None:
        """Learn where `target` (its text) is."""
        self._hunt.found(target, p_map)

    def blocked(self, x: float, y: float, pose: RobotPose | None) -> bool:
        """Learn that one cannot drive through (x, y); whether that is any news.

        The floor the robot stands on stays floor.
        """
        space = self._hunt.space
        cells = set(space.within((x, y), BLOCKS).tolist())
        if pose is not None:
            cells.discard(space.nearest((pose.x, pose.y)))
        if not cells:
            return False
        if cells.issuperset(self._hunt.looks.stands.tolist()):
            self._nowhere = True
            return True
        try:
            self._hunt.blocked(np.array(sorted(cells), np.intp))
        except LayoutError:  # no floor would be left: better a floor that is not quite true
            return False
        return True

    def shows(self, look: LookRecord, p_map: np.ndarray) -> bool:
        """Whether `look` should have shown what lies at `p_map` (3,) [m], with fair certainty."""
        pose = RobotPose(*look.position, look.heading)
        number = self._look_like(pose, look.heading, look.extent)
        if number is None:
            return False
        looks = self._hunt.looks
        off = ((looks.space.centres(looks.cells) - p_map[:2]) ** 2).sum(axis=1)
        chance = float(looks.chance[number, int(np.argmin(off))])
        return chance >= looks.sensor.recall / 2

    def again(
        self,
        looks: Sequence[LookRecord],
        obstacles: Sequence[ObstacleRecord],
        found: Sequence[tuple[str, np.ndarray]] = (),
    ) -> None:
        """Begin afresh from the map, and learn what looks and obstacles taught once more."""
        self._hunt, self._nowhere = self._prepared(), False
        for obstacle in obstacles:
            self.blocked(*obstacle.position, None)
        for target, p_map in found:
            self.found(target, p_map)
        for look in looks:
            for glimpse in look.glimpses:
                self.glimpsed(*glimpse)
            self.missed(RobotPose(*look.position, look.heading), look.heading, look.extent)

    def _prepared(self) -> Hunt:
        hunt = prepare(
            self._map,
            self._words,
            sensor=self._sensor,
            motion=self._motion,
            at=self._at,
            settings=self._settings,
        )
        if hunt is None:
            raise LayoutError(
                "the map has neither places with an area nor objects, so there is nowhere to "
                "search; map a recording into it first"
            )
        return hunt

    def _sweep(self, look: int, came: float) -> tuple[float, float]:
        """Heading to begin with and angle to turn from there [rad], the nearer end first."""
        looks = self._hunt.looks
        extent = float(looks.extent[look])
        if extent >= 2 * math.pi - 1e-9:
            return came, 2 * math.pi
        first, last = (float(end[0]) for end in looks.starts([look]))
        if float(angle_between(came, last)) < float(angle_between(came, first)):
            return math.remainder(last, 2 * math.pi), first - last
        return math.remainder(first, 2 * math.pi), last - first

    def _look_like(self, pose: RobotPose, heading: float, extent: float) -> int | None:
        """The planned look that a look from `pose` amounts to, if there is one."""
        looks = self._hunt.looks
        off = np.linalg.norm(looks.space.centres(looks.stands) - (pose.x, pose.y), axis=1)
        stand = int(np.argmin(off))
        same = (looks.stand == stand) & (np.abs(looks.extent - extent) < 0.01)
        turned = angle_between(looks.heading, heading)
        if extent < 2 * math.pi - 1e-9:
            same &= turned <= ALIKE
        if off[stand] > NEAR or not same.any():
            return None
        among = np.flatnonzero(same)
        return int(among[np.argmin(turned[among])])

    def _pictures(self, heading: float, extent: float) -> list[float]:
        """Headings of pictures that together show `extent` [rad] about `heading`."""
        view = self._hunt.looks.sensor.field_of_view
        count = max(1, math.ceil(extent / view - 1e-6))
        return [heading + (k - (count - 1) / 2) * extent / count for k in range(count)]


def sensor_of(robot: Hello) -> Sensor:
    """What the robot's camera can see; the thesis' where it does not say."""
    plain = Sensor()
    near, far = robot.near, robot.far
    if near is None or far is None or not near < far:
        near, far = plain.near, plain.far
    return Sensor(
        near=near,
        far=far,
        field_of_view=min(robot.field_of_view or plain.field_of_view, 2 * math.pi),
        recall=robot.recall or plain.recall,
    )


def motion_of(robot: Hello) -> Motion:
    """How fast the robot is; the thesis' robot where it does not say."""
    plain = Motion()
    return Motion(robot.speed or plain.speed, robot.turn_rate or plain.turn_rate)


def _said(candidate: Candidate) -> str:
    return f"{candidate.label}: {'; '.join(candidate.facts)}"
