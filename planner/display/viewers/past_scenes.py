"""Scenes of a map's past: what it believed at moments spread over its transactions."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from kg.maps.semantic_map import SemanticMap
from planner.display.plots.drawing import SHOWN_EXISTENCE
from planner.display.viewers.scene import Scene, ScenePlan, SceneReader


def past_scenes(
    semantic_map: SemanticMap, steps: int, least: float = SHOWN_EXISTENCE
) -> Iterator[tuple[Scene, float]]:
    """Up to `steps` earlier scenes, oldest first, each with the robot's time then [s since 1970].

    The present is not among them, and neither is what was before a robot was on the map.
    Raises HistoryError for a map that does not keep its past here.
    """
    log = semantic_map.history.log
    numbers = np.linspace(log.floor, log.last, steps + 1)[:-1]
    for number in dict.fromkeys(int(n) for n in numbers):
        with semantic_map.at(number) as then:
            scene = SceneReader(then, least).read()
        if scene.robot is not None:
            yield scene, scene.robot.stamp


def present_scene(
    semantic_map: SemanticMap, least: float = SHOWN_EXISTENCE, plan: ScenePlan | None = None
) -> tuple[Scene, float]:
    """The scene as it is, with a `plan`, at the robot's time or now [s since 1970]."""
    scene = SceneReader(semantic_map, least).read(plan)
    return scene, time.time() if scene.robot is None else scene.robot.stamp
