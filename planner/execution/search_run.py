"""Search run: plan a view, drive there, take it, update the belief, record it, plan again.

A new plan follows every view and every surprise: an obstacle, an arrival elsewhere, or a new object
that the target is usually near. All state between views is in the graph, so that a killed search
can resume after its last view.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HereaboutsError, RobotError
from kg.model.records import ObjectRecord, SearchState
from mapping.objects.object_mapper import ObjectChanges
from planner.execution.object_updates import (
    POSSIBLE,
    DetectionUpdate,
    DetectionVerifier,
    ObjectUpdates,
    RelatedObjects,
    TargetDetection,
    decay_missed,
)
from planner.execution.options import SearchOptions, SearchOutcome
from planner.execution.protocol import (
    Arrived,
    Blocked,
    DetectionsMessage,
    Failed,
    GoTo,
    OnTheWay,
    RobotPose,
)
from planner.execution.reporter import Reporter
from planner.execution.robot_session import LATE, RobotSession, SearchStopped
from planner.execution.search_log import SearchLog, recent_obstacles
from planner.execution.viewpoint_adapter import (
    ALIKE,
    FailedGoals,
    NextView,
    PassingViews,
    ViewpointAdapter,
)
from planner.execution.wanted_targets import WantedTargets
from planner.search.goals.targets import Target

LOST: Final = 3.0  # [m] from the goal at arrival; beyond, the robot is elsewhere
OFF: Final = 0.5  # [m] from the goal at arrival; beyond, the viewpoint is not free
MAX_LOOKS: Final = 1000


class _BudgetError(Exception):
    """The time budget is used up."""


class SearchRun:
    """One run of one search."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        targets: Sequence[Target],
        adapter: ViewpointAdapter,
        session: RobotSession,
        log: SearchLog,
        options: SearchOptions,
        objects: ObjectUpdates,
    ) -> None:
        self._map, self._targets, self._adapter = semantic_map, WantedTargets(targets), adapter
        self._robot, self._log, self._options, self._objects = session, log, options, objects
        self._verifier = DetectionVerifier()
        self._passing_views = PassingViews()
        self._failed_goals = FailedGoals()
        self._failed_reason = ""  # of the last viewpoint that could not be reached
        self._looked = False  # whether this run took a look
        self._related = RelatedObjects(semantic_map, targets)
        self._old_obstacles = recent_obstacles(semantic_map, log.record.iri, options.clock())
        self._before = log.record.seconds
        self._reporter = Reporter(options.on_event, lambda: self._before + session.seconds)

    def run(self) -> SearchOutcome:
        """Search until all targets are found, no view gains enough, or the search is stopped."""
        self._restore()
        state: SearchState = "stopped"
        try:
            state, reason = self._loop()
        except SearchStopped as stopped:
            reason = str(stopped)
        except _BudgetError:
            state, reason = "given up", "the time budget is used up"
        except HereaboutsError:
            self._end("stopped")
            raise
        self._halt()
        self._end(state)
        outcome = self._log.outcome(state, reason)
        self._reporter.end(outcome)
        return outcome

    def _restore(self) -> None:
        """Restore the targets that earlier runs of this search found."""
        objects = {o.iri: o for o in self._map.objects()}
        self._targets.restore(objects[i] for i in self._log.record.found if i in objects)
        self._rebuild()
        self._note_progress()
        self._reporter.begin(self._log, self._adapter.left)

    def _loop(self) -> tuple[SearchState, str]:
        if line := self._adapter.off_floor(self._robot.pose):
            self._reporter.note(line)
        while self._targets.wanted:
            self._check_budget()
            proposal = self._adapter.next(self._robot.pose)
            if proposal is None and self._retry_obstacles():
                continue
            if proposal is None:
                return "given up", self._why_no_look()
            if len(self._log.looks) >= MAX_LOOKS:
                return "given up", f"{MAX_LOOKS} looks were taken"
            self._reporter.plan(proposal)
            if self._drive(proposal):
                self._look_or_go_on(proposal)
        return "found", "all that was wanted is found"

    def _why_no_look(self) -> str:
        """Why there is no next look: none is worth the way, or none could be reached."""
        failed = self._failed_reason
        if failed and not self._looked:
            return f"nothing could be reached ({failed})"
        if failed:
            return f"no look that can be reached is worth the way any more ({failed})"
        return "no look is worth the way any more"

    def _retry_obstacles(self) -> bool:
        """Forget obstacles of earlier searches before giving up; returns whether there are any."""
        if not self._old_obstacles or not self._adapter.uncertain:
            return False
        self._old_obstacles = ()
        self._reporter.surprise("what was in the way of earlier searches may be gone by now")
        self._rebuild()
        return True

    def _drive(self, goal: NextView) -> bool:
        """Drive to the viewpoint; False if an event calls for a new plan."""
        number = self._robot.next_id()
        self._robot.send(GoTo(number, goal.x, goal.y, goal.heading))
        limit = self._options.timeout + LATE * goal.seconds
        for message in self._robot.messages(limit=limit):
            self._check_budget()
            if isinstance(message, Arrived) and message.id == number:
                return not self._is_lost(goal)
            if isinstance(message, Blocked) and message.id in (number, None):
                self._blocked(goal, message)
                return False
            if isinstance(message, Failed) and message.id in (number, None):
                self._goal_failed(goal, message.reason)
                return False
            if isinstance(message, OnTheWay):
                self._reporter.way(message)
            if isinstance(message, DetectionsMessage) and self._on_the_way(message):
                return False
        self._robot.halt()
        self._goal_failed(goal, f"not there after {limit:.0f} s")
        return False

    def _is_lost(self, goal: NextView) -> bool:
        """Whether the robot arrived far from the viewpoint, which then counts as unreachable."""
        pose = self._robot.pose
        off = math.hypot(pose.x - goal.x, pose.y - goal.y)
        if off > LOST:
            self._reporter.surprise(f"it is {off:.1f} m from where it was sent", pose)
            self._unreachable(goal, "arrived elsewhere")
        return off > LOST

    def _look_or_go_on(self, goal: NextView) -> None:
        """Look from here if that is best, or drive to a better view: pictures on the way count."""
        pose = self._robot.pose
        if math.dist((goal.x, goal.y), (pose.x, pose.y)) <= OFF:
            best = self._adapter.next(pose)
            if best is None:
                return
            elsewhere = math.dist((best.x, best.y), (pose.x, pose.y)) > OFF
            goal = best
            if elsewhere:
                self._reporter.plan(goal)
                if not self._drive(goal):
                    return
        self._look(goal)

    def _look(self, goal: NextView) -> None:
        """Look, record the view, update the belief; verify doubtful detections by another."""
        pose = self._robot.pose
        turned = abs(math.remainder(goal.heading - pose.heading, 2 * math.pi))
        if turned > ALIKE and self._go(pose.x, pose.y, goal.heading) == "found":
            return
        answer = self._look_around(goal.turn, goal.extent)
        self._looked |= answer is not None
        if answer is None:
            self._goal_failed(goal, "the look failed")
            return
        self._failed_goals.reset()
        pose = self._robot.pose
        sightings = self._after_look(pose, goal.middle, goal.extent, answer)
        if math.hypot(pose.x - goal.x, pose.y - goal.y) > OFF:
            self._unreachable(goal, "one cannot stand there")
        for sighting in self._doubtful(sightings)[:3]:
            self._verify(sighting)

    def _look_around(self, turn: float, extent: float) -> DetectionsMessage | None:
        answer = self._robot.look_around(turn, extent)
        if isinstance(answer, Failed):
            self._reporter.surprise(f"the robot cannot look: {answer.reason}")
            return None
        return answer

    def _after_look(
        self, pose: RobotPose, heading: float, extent: float, answer: DetectionsMessage
    ) -> list[TargetDetection]:
        """Write a view and its changes; returns detections that may be of a target."""
        wanted = self._targets.wanted
        sightings, update = self._add_detections(answer, pose)
        found = self._confirm(sightings)
        viewed = [self._adapter.in_view(*picture) for picture in self._passing_views]
        self._adapter.missed(pose, heading, extent)
        self._note_progress()
        look = self._log.look(
            pose,
            heading,
            extent,
            sorted({kind for target in wanted for kind in target.queried}),
            found=found,
            changes=update.changes,
            shown=update.shown,
            glimpses=tuple(self._passing_views),
            viewed=[*viewed, self._adapter.in_view(pose.x, pose.y, heading, extent)],
        )
        self._passing_views = PassingViews()
        things = [detection.thing for detection in update.detections]
        self._reporter.look(look, things, self._adapter.left)
        self._replan_for(update.changes.updated)
        return sightings

    def _doubtful(self, sightings: Sequence[TargetDetection]) -> list[TargetDetection]:
        """Uncertain detections that another view may verify, one for each spot."""
        wanted = [s for s in sightings if not self._targets.is_found(s.target)]
        return self._verifier.doubtful(wanted)

    def _on_the_way(self, message: DetectionsMessage) -> bool:
        """Apply a picture taken while driving; returns whether it changes the plan."""
        sightings, found, changes = self._apply_passing(message)
        doubtful = self._doubtful(sightings)
        if not found and not doubtful:
            pose = message.pose or self._robot.pose
            if not sightings and self._passing_views.add(pose):
                self._adapter.missed_picture(pose.x, pose.y, pose.heading)
            return self._replan_for(changes.updated)
        self._robot.halt()
        for sighting in doubtful[:1]:
            self._verify(sighting)
        return True

    def _apply_passing(
        self, message: DetectionsMessage
    ) -> tuple[list[TargetDetection], tuple[str, ...], ObjectChanges]:
        """Write a picture taken while driving; returns possible targets, IRIs found, changes."""
        sightings, update = self._add_detections(message, message.pose or self._robot.pose)
        found, changes = self._confirm(sightings), update.changes
        if changes.updated or changes.removed:
            self._note_progress()
            self._log.sighting(self._robot.pose, changes, update.shown, found)
        return sightings, found, changes

    def _add_detections(
        self, message: DetectionsMessage, pose: RobotPose
    ) -> tuple[list[TargetDetection], DetectionUpdate]:
        update = self._objects.add(message, self._options.clock(), pose)
        self._reporter.unknown(update.unknown)
        sightings = [
            self._verifier.judge(target, detection)
            for detection in update.detections
            for target in self._targets.wanted
            if target.accepts(detection.category, detection.iri)
        ]
        return sightings, update

    def _confirm(self, sightings: Sequence[TargetDetection]) -> tuple[str, ...]:
        """Mark certain detections as found; returns the objects' IRIs."""
        found = []
        for sighting in sightings:
            iri = sighting.object
            if sighting.certain and iri is not None and not self._targets.is_found(sighting.target):
                self._targets.add_found(sighting.target.text, sighting.p_map)
                self._adapter.found(sighting.target.text, sighting.p_map)
                found.append(iri)
                self._reporter.found(sighting, iri)
        return tuple(found)

    def _verify(self, sighting: TargetDetection) -> None:
        """View a possible target until it is found, or missed and improbable."""
        while not self._targets.is_found(sighting.target) and self._verifier.open(sighting):
            shown = self._shown_again(sighting)
            self._verifier.count_view(sighting)
            if not shown and self._objects.existence(sighting.thing) < POSSIBLE:
                return

    def _shown_again(self, sighting: TargetDetection) -> bool:
        """Whether a view from another viewpoint shows a possible target; a miss lowers existence.

        A second view from the same viewpoint would prove little, since it has the same errors.
        """
        thing, aside = sighting.thing, self._verifier.aside(sighting)
        x, y = self._adapter.another_view(self._robot.pose, sighting.p_map, aside)
        heading = math.atan2(thing.y - y, thing.x - x)
        self._reporter.surprise(
            f"perhaps {thing.label} at ({thing.x:.1f}, {thing.y:.1f}), score {thing.score:.2f}: "
            "looking again"
        )
        arrived = self._go(x, y, heading)
        if arrived != "there":
            return arrived == "found"
        answer = self._look_around(0.0, self._adapter.field_of_view)
        if answer is None:
            return False
        at = self._robot.pose
        sightings = self._after_look(at, heading, self._adapter.field_of_view, answer)
        shown = self._targets.is_found(sighting.target) or any(map(sighting.shows, sightings))
        if not shown and sighting.object is not None:
            changes = self._objects.decay(sighting.object, recall=self._adapter.recall)
            if changes.updated or changes.removed:
                self._log.change("looked again, nothing found", changes)
        return shown

    def _go(self, x: float, y: float, heading: float) -> Literal["there", "found", "failed"]:
        """Drive to (x, y) [m] nearby, or turn on the spot, until there or a target is found."""
        for message in self._robot.go_to(x, y, heading):
            if isinstance(message, DetectionsMessage) and self._apply_passing(message)[1]:
                self._robot.halt()
                return "found"
            if isinstance(message, Blocked | Failed):
                return "failed"
        return "there"

    def _blocked(self, goal: NextView, message: Blocked) -> None:
        pose, x, y, reason = self._robot.pose, message.x, message.y, message.reason
        self._reporter.surprise(f"blocked at ({x:.1f}, {y:.1f}): {reason}", pose)
        self._note_progress()
        self._log.obstacle(pose, x, y, reason)
        if not self._adapter.blocked(x, y, pose):
            self._goal_failed(goal, reason)

    def _goal_failed(self, goal: NextView, reason: str) -> None:
        self._reporter.surprise(f"did not work: {reason}")
        if self._failed_goals.add(goal, reason):
            self._failed_reason = reason
            self._unreachable(goal, reason)

    def _unreachable(self, goal: NextView, reason: str) -> None:
        self._note_progress()
        self._log.obstacle(self._robot.pose, goal.x, goal.y, reason)
        self._adapter.blocked(goal.x, goal.y, self._robot.pose)

    def _replan_for(self, records: Sequence[ObjectRecord]) -> bool:
        """Plan again if a new object was seen that a target is usually near."""
        new = self._related.new_among(records, self._targets.wanted) if records else []
        if not new:
            return False
        labels = sorted({self._map.catalogue.label(record.category) for record in new})
        self._reporter.surprise(f"new on the map: {', '.join(labels)}; what is wanted may be near")
        self._rebuild()
        return True

    def _rebuild(self) -> None:
        obstacles = (*self._old_obstacles, *self._log.obstacles)
        self._adapter.rebuild(self._log.looks, obstacles, self._targets.found)
        for picture in self._passing_views:
            self._adapter.missed_picture(*picture)

    def _check_budget(self) -> None:
        budget = self._options.budget
        if budget is not None and self._robot.seconds > budget:
            raise _BudgetError

    def _halt(self) -> None:
        try:
            self._robot.halt()
        except RobotError as error:
            self._reporter.note(f"could not be stopped: {error}")

    def _end(self, state: SearchState) -> None:
        changes = ObjectChanges()
        if state != "stopped":  # a resumed search needs the objects unchanged
            kinds = {kind for target in self._targets.all for kind in target.kinds}
            changes = decay_missed(self._objects.of(kinds), self._objects, self._adapter, self._log)
        self._note_progress()
        self._log.end(state, self._robot.pose_if_known, changes)

    def _note_progress(self) -> None:
        left = self._adapter.left if self._targets.wanted else 0.0
        self._log.note_progress(left=left, seconds=self._before + self._robot.seconds)
