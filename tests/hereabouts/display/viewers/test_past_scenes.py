"""Scenes of a map's past."""

import numpy as np

from hereabouts.display.viewers.scene import past_scenes, present_scene
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, RobotRecord
from tests.hereabouts.display.viewers.conftest import thing


def test_scenes_of_the_past_are_what_was_believed_then(kitchen: SemanticMap) -> None:
    for step in range(1, 4):
        robot = RobotRecord(np.array([2.0 + step, 1.0, 1.2]), 0.5, 1000.25 + step)
        chair = thing(kitchen, "chair", (3, 1, 0.4))
        kitchen.apply(MapUpdate(objects=(chair,), robot=robot))
    past = list(past_scenes(kitchen, 100))
    scene, stamp = present_scene(kitchen)
    # the first transaction is the map's own, without a robot; the last one is the present
    assert [round(then) for _, then in past] == [1000, 1001, 1002]
    assert round(stamp) == 1003
    chairs = [sum(o.text == "chair" for o in s.objects) for s in [*(s for s, _ in past), scene]]
    assert chairs == [0, 1, 2, 3]
    assert len(list(past_scenes(kitchen, 1))) <= 1
