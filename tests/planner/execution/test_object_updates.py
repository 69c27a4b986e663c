"""What a robot sees on a search goes into the map as what a recording shows."""

from dataclasses import replace

import numpy as np
import pytest

from hereabouts.demo.house_demo import HIDDEN, layout_of
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map
from mapping.objects.bayes_mapper import BayesObjectMapper
from perception.frames import Detections
from planner.execution.object_updates import DetectionUpdate, DetectionVerifier, ObjectUpdates
from planner.execution.protocol import Detected, DetectedFrame, DetectionsMessage, RobotPose
from planner.search.goals.targets import resolve
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import House, furnished_house
from planner.simulation.sensors import SimulatedDetector
from tests.planner.robots import APPLE, START, ring, run

THROUGH_THE_DOOR = [(1.9, 7.05), (2.5, 7.1), (3.1, 7.2), (3.6, 7.3)]  # the apple is behind it
ANYWHERE = RobotPose(0.0, 0.0, 0.0)


def _towards_apple(camera, spots):
    """Pictures from `spots` towards the hidden apple, each thing found with its true box."""
    views = []
    for number, (x, y) in enumerate(spots):
        heading = float(np.arctan2(HIDDEN.y - y, HIDDEN.x - x))
        T_map_cam = camera.model.pose(x, y, heading)
        frame = camera.frame(f"frame-{number}", T_map_cam, START)
        views.append(DetectedFrame(frame, _true_detections(camera, T_map_cam)))
    return views


def _true_detections(camera: SimulatedCamera, T_map_cam: np.ndarray) -> Detections:
    instance = camera.view(T_map_cam).instance
    seen = [int(i) for i in np.unique(instance) if i >= 0 and (instance == i).sum() >= 12]
    boxes = np.zeros((len(seen), 4), np.float32)
    for row, i in enumerate(seen):
        v, u = np.nonzero(instance == i)
        boxes[row] = u.min(), v.min(), u.max(), v.max()
    labels = tuple(camera.house.objects[i].label for i in seen)
    return Detections(boxes, np.full(len(seen), 0.8, np.float32), labels)


def _house() -> House:
    return furnished_house().with_objects([HIDDEN])


def _records(semantic_map: SemanticMap) -> list[tuple[str, int, float, tuple[float, ...]]]:
    return sorted(
        (o.category, o.observations, round(o.existence, 6), tuple(o.p_map.round(6)))
        for o in semantic_map.perceived.objects()
    )


def _written(semantic_map: SemanticMap, update: DetectionUpdate) -> DetectionUpdate:
    changes = update.changes
    semantic_map.apply(MapUpdate(changes.updated, changes.removed, departed=changes.departed))
    return update


def test_a_look_gives_the_map_that_a_recording_of_its_pictures_gives(semantic_map):
    camera = SimulatedCamera(furnished_house())
    detector = SimulatedDetector(camera)
    views = []
    for number, (x, heading) in enumerate((x, h) for x in (4.5, 5.0) for h in (0.0, 0.5, 1.0)):
        frame = camera.frame(f"frame-{number}", camera.model.pose(x, 6.2, heading), START)
        views.append(DetectedFrame(frame, detector.detect(frame)))
    updates = ObjectUpdates(semantic_map, "search/1", detector.name)
    for look in (views[:3], views[3:]):
        message = DetectionsMessage(1, views=tuple(look))
        _written(semantic_map, updates.add(message, START, ANYWHERE))
    with in_memory_map() as other:
        mapper = BayesObjectMapper(other, model=detector.name)
        for view in views:
            changes = mapper.add(view.frame, view.detections)
            other.apply(MapUpdate(changes.updated, changes.removed))
        assert len(_records(other)) >= 5
        assert _records(semantic_map) == _records(other)


def test_a_thing_seen_through_a_doorway_lies_in_the_room_behind(semantic_map: SemanticMap) -> None:
    house = _house()
    places = [
        PlaceRecord(
            semantic_map.place_iri(p.number),
            p.label,
            p.area.xmin,
            p.area.xmax,
            p.area.ymin,
            p.area.ymax,
            5,
        )
        for p in layout_of(house).places
    ]
    semantic_map.apply(MapUpdate(places=tuple(places)))
    views = _towards_apple(SimulatedCamera(house), THROUGH_THE_DOOR)
    updates = ObjectUpdates(semantic_map, "search/1")
    _written(semantic_map, updates.add(DetectionsMessage(1, views=tuple(views)), START, ANYWHERE))
    (apple,) = semantic_map.objects("apple")
    room = house.room_at(HIDDEN.x, HIDDEN.y)
    assert room is not None and room.name == "dining room"
    assert house.room_at(*THROUGH_THE_DOOR[-1]) != room
    assert apple.place == semantic_map.place_iri(house.rooms.index(room) + 1)
    assert np.linalg.norm(apple.p_map - HIDDEN.centre()) < 0.2


def test_one_picture_leaves_doubt_and_one_from_elsewhere_decides(semantic_map: SemanticMap) -> None:
    (target,) = resolve(semantic_map, ["apple"])
    near, aside = (5.9, 8.6), (6.2, 7.9)
    one, other = _towards_apple(SimulatedCamera(_house()), [near, aside])
    updates, verifier = ObjectUpdates(semantic_map), DetectionVerifier()

    def apples(*views: DetectedFrame) -> list[bool]:
        update = updates.add(DetectionsMessage(1, views=views), START, ANYWHERE)
        _written(semantic_map, update)
        found = [d for d in update.detections if d.category in target.kinds]
        return [verifier.judge(target, detection).certain for detection in found]

    apples(one)
    assert all(record.existence < 0.9 for record in semantic_map.objects("apple"))
    assert all(apples(other))
    (apple,) = semantic_map.objects("apple")
    assert apple.existence > 0.9


def test_what_pictures_miss_counts_once(semantic_map: SemanticMap) -> None:
    apple = ObjectRecord(
        iri=semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find("apple").iri,
        p_map=HIDDEN.centre(),
        confidence=2.4,
        existence=0.8,
        observations=5,
        first_seen=START,
        last_seen=START,
    )
    semantic_map.apply(MapUpdate(objects=(apple,)))
    updates = ObjectUpdates(semantic_map)
    (view,) = _towards_apple(SimulatedCamera(furnished_house()), [(5.9, 8.6)])
    update = updates.add(DetectionsMessage(1, views=(view,)), START, ANYWHERE)
    (missed,) = [record for record in update.changes.updated if record.iri == apple.iri]
    assert missed.existence < apple.existence
    assert apple.iri not in update.shown
    assert updates.decay(apple.iri).updated == ()


@pytest.mark.parametrize("messages", [1, 100])
def test_one_spot_makes_nothing_certain(semantic_map: SemanticMap, messages: int) -> None:
    apple = Detected("apple", 0.6, 2.0, 0.0, 0.8)
    updates = ObjectUpdates(semantic_map)
    for number in range(messages):
        message = DetectionsMessage(None, (apple,) * 5)
        _written(semantic_map, updates.add(message, START + number, ANYWHERE))
    (record,) = semantic_map.objects("apple")
    assert record.existence < (0.5 if messages == 1 else 0.97)
    there = replace(ANYWHERE, y=1.0)
    _written(semantic_map, updates.add(DetectionsMessage(None, (apple,)), START + 200, there))
    assert semantic_map.objects("apple")[0].existence > record.existence


def test_why_names_the_picture_and_the_box_that_a_robot_sent(semantic_map: SemanticMap) -> None:
    ring(semantic_map)
    seen = [*APPLE, "left/17", [10, 20, 30, 40], 1.9]
    run(semantic_map, "apple", objects=[seen], hello={"detector": "good eyes"})
    (apple,) = semantic_map.objects("apple")
    assert apple.evidence is not None
    assert (apple.evidence.recording, apple.evidence.frame) == ("search/1", "left/17")
    (reason,) = semantic_map.history.explain(apple.iri)
    told = [step.text for _, step in reason.walk()]
    (text,) = [
        text for text in told if text.startswith("seen best in left/17 of search for apple at ")
    ]
    assert text.endswith("box 10 20 30 40 px, score 0.9")
    assert "detector good eyes" in told
    (row,) = semantic_map.query("why-object", object=apple.iri).records()
    assert (row["recording"], row["frame"]) == ("search for apple", "left/17")
