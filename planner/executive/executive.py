"""A search carried out: propose a look, drive there, look, learn, write it down, propose again.

Every look and every surprise is followed by a new plan: something in the way, a robot that ends up
elsewhere, a thing on the way that what is wanted is usually near. Nothing is kept between looks
that the graph does not hold, so that a search that is killed goes on where its last look ended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, Literal

from kg.errors import HereaboutsError, RobotError
from kg.records import ObjectRecord, SearchState
from kg.semantic_map import SemanticMap
from planner.executive.diary import Diary, shut_lately, to_resume
from planner.executive.findings import Findings
from planner.executive.guide import Guide, Proposal
from planner.executive.listening import Listener, SearchStopped
from planner.executive.narration import Narrator
from planner.executive.protocol import (
    Arrived,
    Blocked,
    Detected,
    Detections,
    Failed,
    GoTo,
    Hello,
    LookAround,
    RobotPose,
)
from planner.executive.robots import Robot
from planner.executive.sightings import Sighting, Sightings
from planner.executive.terms import Outcome, Terms
from planner.finding.targets import Target, resolve

LOST: Final = 3.0  # [m] a robot that arrives this far off is not where it was sent
OFF: Final = 0.5  # [m] one that arrives this far off could not stand where it was sent
MOST_LOOKS: Final = 1000
MOST_FAILURES: Final = 25  # commands that fail with no look between them
_GLIMPSE: Final = 1.0  # [m] pictures on the way that are nearer to each other show the same
_SLOWNESS: Final = 5.0  # times the expected seconds after which a robot is late


class _OverError(Exception):
    """The time budget is used up."""


def search(
    semantic_map: SemanticMap,
    words: Sequence[str],
    robot: Robot,
    terms: Terms | None = None,
    *,
    resume: bool = False,
) -> Outcome:
    """Search for all of `words` (as `find` takes them) with `robot`, which is closed at the end.

    With `resume` the latest unfinished search for them goes on (for anything, without words).
    Raises UnknownCategoryError for what is no target, GraphError where there is nothing to resume,
    LayoutError where there is nowhere to search, RobotError where the robot fails; the search is
    then stopped and can be resumed.
    """
    terms = terms or Terms()
    try:
        before = to_resume(semantic_map, words) if resume else None
        words = before.words if before else tuple(dict.fromkeys(words))
        targets = resolve(semantic_map, words)
        semantic_map.store.refuse_read_only()
        listener = Listener(robot, terms.patience, terms.stopping)
        hello = _greeted(listener)
        at = before.started if before else terms.clock()
        guide = Guide(semantic_map, words, hello, at, terms.give_up_at)
        if before:
            diary = Diary.resume(semantic_map, before, terms.clock)
        else:
            categories = sorted({kind for target in targets for kind in target.asked})
            diary = Diary.begin(semantic_map, words, categories, terms.clock)
        return _Run(semantic_map, targets, guide, listener, diary, terms).run()
    finally:
        robot.close()


class _Run:
    """One run of one search."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        targets: Sequence[Target],
        guide: Guide,
        listener: Listener,
        diary: Diary,
        terms: Terms,
    ) -> None:
        self._map, self._targets, self._guide = semantic_map, tuple(targets), guide
        self._robot, self._diary, self._terms = listener, diary, terms
        self._findings = Findings(semantic_map)
        self._sightings = Sightings()
        self._found: dict[str, tuple[str, Any]] = {}  # target's text -> object IRI, position
        self._glimpses: list[tuple[float, float, float]] = []
        self._unknown: set[str] = set()
        self._failures: dict[tuple[float, float], int] = {}
        self._failed = 0
        self._near = self._related()
        self._shut = shut_lately(semantic_map, diary.record.iri, terms.clock())
        self._before = diary.record.seconds
        self._narrator = Narrator(terms.tell, lambda: self._before + listener.seconds)

    def run(self) -> Outcome:
        """Search until all is found, nothing is worth a look, or it is stopped."""
        self._take_up()
        state: SearchState = "stopped"
        try:
            state, reason = self._loop()
        except SearchStopped as stopped:
            reason = str(stopped)
        except _OverError:
            state, reason = "given up", "the time budget is used up"
        except HereaboutsError:
            self._end("stopped")
            raise
        self._halt()
        self._end(state)
        outcome = self._outcome(state, reason)
        self._narrator.end(outcome)
        return outcome

    def _take_up(self) -> None:
        """Learn again what earlier runs of this search saw."""
        record = self._diary.record
        objects = {o.iri: o for o in self._map.objects()}
        for iri in record.found:
            for target in self._targets:
                if iri in objects and objects[iri].category in target.kinds:
                    self._found.setdefault(target.text, (iri, objects[iri].p_map))
        self._learn_again()
        self._note_progress()
        self._narrator.begin(
            self._diary.name, self._diary.record, self._guide.left, len(self._diary.looks)
        )

    def _loop(self) -> tuple[SearchState, str]:
        while self._wanted():
            self._refuse_over_budget()
            proposal = self._guide.next(self._robot.pose)
            if proposal is None and self._tried_again():
                continue
            if proposal is None:
                return "given up", "no look is worth the way any more"
            if len(self._diary.looks) >= MOST_LOOKS:
                return "given up", f"{MOST_LOOKS} looks were taken"
            self._narrator.plan(proposal)
            if self._drive(proposal) == "arrived":
                self._look(proposal)
        return "found", "all that was wanted is found"

    def _tried_again(self) -> bool:
        """Whether ways that were shut to earlier searches are to be tried before giving up."""
        if not self._shut or not self._guide.unsure:
            return False
        self._shut = ()
        self._narrator.surprise("what was in the way of earlier searches may be gone by now")
        self._learn_again()
        return True

    def _wanted(self) -> tuple[Target, ...]:
        return tuple(t for t in self._targets if t.text not in self._found)

    def _drive(self, goal: Proposal) -> Literal["arrived", "else"]:
        """Drive to where the look is to begin; "else": what happened calls for a new plan."""
        number = self._robot.next_id()
        self._robot.send(GoTo(number, goal.x, goal.y, goal.heading))
        self._glimpses = []
        limit = self._terms.patience + _SLOWNESS * goal.seconds
        for message in self._robot.messages(limit=limit):
            self._refuse_over_budget()
            if isinstance(message, Arrived) and message.id == number:
                return self._arrived(goal)
            if isinstance(message, Blocked) and message.id in (number, None):
                self._blocked(goal, message)
                return "else"
            if isinstance(message, Failed) and message.id in (number, None):
                self._goal_failed(goal, message.reason)
                return "else"
            if isinstance(message, Detections) and self._on_the_way(message, goal):
                return "else"
        self._robot.halt()
        self._goal_failed(goal, f"not there after {limit:.0f} s")
        return "else"

    def _arrived(self, goal: Proposal) -> Literal["arrived", "else"]:
        pose = self._robot.pose
        off = math.hypot(pose.x - goal.x, pose.y - goal.y)
        if off > LOST:
            self._narrator.surprise(f"it is {off:.1f} m from where it was sent", pose)
            self._unreachable(goal, "arrived elsewhere")
            return "else"
        return "arrived"

    def _look(self, goal: Proposal) -> None:
        """Look, write it down, learn from it; what is doubtful is looked at once more."""
        answer = self._look_around(goal.turn, goal.extent)
        if answer is None:
            self._goal_failed(goal, "the look failed")
            return
        self._failed = 0
        pose = self._robot.pose
        middle = goal.middle
        doubtful = self._after_look(pose, middle, goal.extent, answer.objects)
        if math.hypot(pose.x - goal.x, pose.y - goal.y) > OFF:
            self._unreachable(goal, "one cannot stand there")
        for sighting in doubtful[:3]:
            self._verify(sighting)

    def _look_around(self, turn: float, extent: float) -> Detections | None:
        number = self._robot.next_id()
        self._robot.send(LookAround(number, turn, extent))
        limit = self._terms.patience * 2 + _SLOWNESS * 2 * math.pi / 0.1
        for message in self._robot.messages(limit=limit):
            if isinstance(message, Detections) and message.id == number:
                return message
            if isinstance(message, Failed) and message.id in (number, None):
                self._narrator.surprise(f"the robot cannot look: {message.reason}")
                return None
        return None

    def _after_look(
        self, pose: RobotPose, heading: float, extent: float, things: Sequence[Detected]
    ) -> list[Sighting]:
        """Write a look and what it showed; returns what might be a target, and is doubtful."""
        wanted = self._wanted()
        sightings, records = self._take_in(things)
        found = self._believe(sightings)
        for x, y, towards in self._glimpses:
            self._guide.glimpsed(x, y, towards)
        self._guide.missed(pose, heading, extent)
        self._note_progress()
        look = self._diary.look(
            pose,
            heading,
            extent,
            sorted({kind for target in wanted for kind in target.asked}),
            found=found,
            objects=records,
            glimpses=self._glimpses,
        )
        self._glimpses = []
        self._narrator.look(look, things, self._guide.left)
        self._heed_new(records)
        return [s for s in sightings if not s.certain and not self._is_found(s)]

    def _on_the_way(self, message: Detections, goal: Proposal) -> bool:
        """Take in a picture taken while driving; whether it changes the plan."""
        pose = message.pose or self._robot.pose
        sightings, records = self._take_in(message.objects)
        found = self._believe(sightings)
        if not sightings:
            self._glimpse(pose, goal)
        if records:
            self._note_progress()
            self._diary.sighting(self._robot.pose, records, found)
        doubtful = [s for s in sightings if not s.certain and not self._is_found(s)]
        if not found and not doubtful:
            return self._heed_new(records)
        self._robot.halt()
        for sighting in doubtful[:1]:
            self._verify(sighting)
        return True

    def _glimpse(self, pose: RobotPose, goal: Proposal) -> None:
        """Remember a picture in vain, unless it shows much the same as the last, or as the look."""
        near_goal = math.hypot(pose.x - goal.x, pose.y - goal.y) < _GLIMPSE
        if near_goal:
            return
        if self._glimpses:
            x, y, heading = self._glimpses[-1]
            turned = abs(math.remainder(pose.heading - heading, 2 * math.pi))
            if math.hypot(pose.x - x, pose.y - y) < _GLIMPSE and turned < 0.8:
                return
        self._glimpses.append((round(pose.x, 2), round(pose.y, 2), round(pose.heading, 2)))

    def _take_in(self, things: Sequence[Detected]) -> tuple[list[Sighting], list[ObjectRecord]]:
        seen = self._findings.seen(things, self._terms.clock())
        for label in seen.unknown:
            if label not in self._unknown and len(self._unknown) < 100:
                self._unknown.add(label)
                self._narrator.note(f"no category of objects is called {label!r}: left out")
        named = [(thing, self._findings.category(thing.label)) for thing in things]
        sightings = [
            self._sightings.judge(target, category, thing)
            for thing, category in named
            for target in self._wanted()
            if category is not None and category in target.kinds
        ]
        return sightings, list(seen.objects)

    def _believe(self, sightings: Sequence[Sighting]) -> tuple[str, ...]:
        """Take the certain ones for found; returns the objects' IRIs."""
        found = []
        for sighting in sightings:
            iri = self._findings.object_at(sighting.category, sighting.p_map)
            if sighting.certain and iri is not None and not self._is_found(sighting):
                self._found[sighting.target.text] = (iri, sighting.p_map)
                self._guide.found(sighting.target.text, sighting.p_map)
                found.append(iri)
                self._narrator.found(sighting, iri)
        return tuple(found)

    def _is_found(self, sighting: Sighting) -> bool:
        return sighting.target.text in self._found

    def _verify(self, sighting: Sighting) -> None:
        """Look straight at what may be a target; without a second detection it is let go."""
        if self._is_found(sighting) or sighting.again:
            return
        pose, thing = self._robot.pose, sighting.thing
        heading = math.atan2(thing.y - pose.y, thing.x - pose.x)
        self._narrator.surprise(
            f"perhaps {thing.label} at ({thing.x:.1f}, {thing.y:.1f}), score {thing.score:.2f}: "
            "looking again"
        )
        number = self._robot.next_id()
        self._robot.send(GoTo(number, pose.x, pose.y, heading))
        for message in self._robot.messages(limit=2 * self._terms.patience):
            if isinstance(message, Arrived) and message.id == number:
                break
            if isinstance(message, Blocked | Failed):
                return
        answer = self._look_around(0.0, self._guide.field_of_view)
        if answer is None:
            return
        at = self._robot.pose
        self._after_look(at, heading, self._guide.field_of_view, answer.objects)
        if not self._is_found(sighting):
            self._doubt(sighting)

    def _doubt(self, sighting: Sighting) -> None:
        """A second look did not show it: one missed frame's worth of evidence against it."""
        iri = self._findings.object_at(sighting.category, sighting.p_map)
        for record in self._findings.of((sighting.category,)):
            if record.iri == iri:
                after = self._findings.missed(record)
                removed = () if after else (record.iri,)
                self._diary.change("looked again in vain", (after,) if after else (), removed)

    def _blocked(self, goal: Proposal, message: Blocked) -> None:
        pose = self._robot.pose
        self._narrator.surprise(
            f"blocked at ({message.x:.1f}, {message.y:.1f}): {message.reason}", pose
        )
        self._note_progress()
        self._diary.obstacle(pose, message.x, message.y, message.reason)
        if not self._guide.blocked(message.x, message.y, pose):
            self._goal_failed(goal, message.reason)

    def _goal_failed(self, goal: Proposal, reason: str) -> None:
        """A goal that was not reached twice is not tried a third time."""
        self._narrator.surprise(f"did not work: {reason}")
        self._failed += 1
        if self._failed >= MOST_FAILURES:
            raise RobotError(f"{MOST_FAILURES} commands in a row failed, the last one: {reason}")
        key = round(goal.x, 1), round(goal.y, 1)
        self._failures[key] = self._failures.get(key, 0) + 1
        if self._failures[key] >= 2:
            self._unreachable(goal, reason)

    def _unreachable(self, goal: Proposal, reason: str) -> None:
        self._note_progress()
        self._diary.obstacle(self._robot.pose, goal.x, goal.y, reason)
        self._guide.blocked(goal.x, goal.y, self._robot.pose)

    def _related(self) -> frozenset[str]:
        """IRIs of objects that something still wanted is usually near."""
        found = set()
        for target in self._wanted():
            for category in target.asked:
                rows = self._map.ask("goals-nearby", category=category).records()
                found |= {str(row["iri"]) for row in rows}
        return frozenset(found)

    def _heed_new(self, records: Sequence[ObjectRecord]) -> bool:
        """Plan afresh where something new was seen that what is wanted is usually near."""
        if not records or not self._wanted():
            return False
        related = self._related()
        new = [record for record in records if record.iri in related - self._near]
        self._near = related
        if not new:
            return False
        labels = sorted({self._map.catalogue.label(record.category) for record in new})
        self._narrator.surprise(f"new on the map: {', '.join(labels)}; what is wanted may be near")
        self._learn_again()
        return True

    def _learn_again(self) -> None:
        found = [(text, p_map) for text, (_, p_map) in self._found.items()]
        obstacles = (*self._shut, *self._diary.obstacles)
        self._guide.again(self._diary.looks, obstacles, found)

    def _refuse_over_budget(self) -> None:
        budget = self._terms.budget
        if budget is not None and self._robot.seconds > budget:
            raise _OverError

    def _halt(self) -> None:
        try:
            self._robot.halt()
        except RobotError as error:
            self._narrator.note(f"could not be told to stop: {error}")

    def _end(self, state: SearchState) -> None:
        objects, removed = ((), ()) if state == "stopped" else self._not_seen()
        self._note_progress()
        self._diary.end(state, self._robot.pose_if_known, objects, removed)

    def _not_seen(self) -> tuple[tuple[ObjectRecord, ...], tuple[str, ...]]:
        """What the map holds of what was wanted, and looks should have shown and did not.

        It counts once the search is over: before, the looks themselves say it.
        """
        kinds = {kind for target in self._targets for kind in target.kinds}
        kept, gone = [], []
        for record in self._findings.of(tuple(kinds)):
            times = sum(
                self._guide.shows(look, record.p_map)
                for look in self._diary.looks
                if look.stamp > record.last_seen and not look.found
            )
            if times and record.iri not in self._diary.record.found:
                after = self._findings.missed(record, times)
                kept += [after] if after else []
                gone += [] if after else [record.iri]
        return tuple(kept), tuple(gone)

    def _note_progress(self) -> None:
        left = self._guide.left if self._wanted() else 0.0
        self._diary.note_progress(left=left, seconds=self._before + self._robot.seconds)

    def _outcome(self, state: SearchState, reason: str) -> Outcome:
        record = self._diary.record
        return Outcome(
            search=record.iri,
            state=state,
            reason=reason,
            found=record.found,
            left=record.left,
            seconds=record.seconds,
            looks=len(self._diary.looks),
        )


def _greeted(listener: Listener) -> Hello:
    try:
        return listener.greet()
    except SearchStopped as stopped:
        raise RobotError(f"{stopped}, before the search began") from stopped
