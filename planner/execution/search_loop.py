"""Search for objects with a robot: the map, the robot and the search's log, put together."""

from __future__ import annotations

from collections.abc import Sequence

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import RobotError
from planner.execution.object_updates import ObjectUpdates
from planner.execution.options import SearchOptions, SearchOutcome
from planner.execution.robot import Robot
from planner.execution.robot_session import RobotSession, SearchStopped
from planner.execution.search_log import SearchLog, to_resume
from planner.execution.search_run import SearchRun
from planner.execution.viewpoint_adapter import ViewpointAdapter
from planner.search.goals.targets import resolve


def search(
    semantic_map: SemanticMap,
    words: Sequence[str],
    robot: Robot,
    options: SearchOptions | None = None,
    *,
    resume: bool = False,
) -> SearchOutcome:
    """Search for all of `words` (as `find` takes them) with `robot`, which is closed at the end.

    Args:
        semantic_map: The map.
        words: Texts that name targets.
        robot: Connection to the robot.
        options: Options of the search.
        resume: Whether to continue the latest unfinished search for the words; without words, the
            latest unfinished search.

    Raises:
        UnknownCategoryError: A text names no target.
        GraphError: There is no search to resume.
        LayoutError: The map has no floor to search.
        RobotError: The robot fails. The search is then stopped and can be resumed.
    """
    options = options or SearchOptions()
    try:
        before = to_resume(semantic_map, words) if resume else None
        words = before.words if before else tuple(dict.fromkeys(words))
        targets = resolve(semantic_map, words)
        options.labels.check_categories(semantic_map.catalogue)
        semantic_map.store.check_writable()
        session = RobotSession(robot, options.timeout, options.stopping)
        try:
            hello = session.greet()
        except SearchStopped as stopped:
            raise RobotError(f"{stopped}, before the search began") from stopped
        at = before.started if before else options.clock()
        adapter = ViewpointAdapter(semantic_map, words, hello, at, options.give_up_at)
        if before:
            log = SearchLog.resume(semantic_map, before, options.clock)
        else:
            categories = sorted({kind for target in targets for kind in target.queried})
            log = SearchLog.begin(semantic_map, words, categories, options.clock)
        objects = ObjectUpdates(semantic_map, log.name, hello.detector or "", options.labels)
        return SearchRun(semantic_map, targets, adapter, session, log, options, objects).run()
    finally:
        robot.close()
