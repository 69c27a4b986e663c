"""The simulated robot of the demo house: rendered pictures, a detector with faults."""

from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from hereabouts.demo.house_demo import HIDDEN, layout_of
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord, RecordingRecord, RobotRecord
from kg.serving.opening import create_map, in_memory_map, open_map
from planner.search.goals.known_objects import known_objects
from planner.search.goals.targets import resolve
from planner.simulation.house import House, furnished_house
from planner.simulation.house_robot import DEMO_RECORDING, START, simulated_robot


def _mapped(semantic_map: SemanticMap, house: House) -> None:
    """The house as a tour would have mapped it, without the time that a tour takes."""
    find = semantic_map.catalogue.find
    places = [
        PlaceRecord(
            semantic_map.place_iri(place.number),
            place.label,
            place.area.xmin,
            place.area.xmax,
            place.area.ymin,
            place.area.ymax,
            20,
            {find(room.category, "place").iri: 0.6},
        )
        for place, room in zip(layout_of(house).places, house.rooms, strict=True)
    ]
    objects = [
        ObjectRecord(
            iri=semantic_map.new_object_iri(),
            category=find(item.label).iri,
            p_map=item.centre(),
            confidence=3.0,
            existence=1.0,
            observations=9,
            first_seen=START,
            last_seen=START,
        )
        for item in house.objects
    ]
    x, y = house.rooms[0].viewpoints[0]
    robot = RobotRecord(np.array([x, y, 1.25]), 0.0, START)
    toured = RecordingRecord(DEMO_RECORDING, 1, "frame-000000", np.eye(4))
    semantic_map.apply(MapUpdate(tuple(objects), (), tuple(places), robot, toured))


def test_the_apple_is_found_within_a_few_looks_by_the_robots_clock(tmp_path: Path) -> None:
    path = tmp_path / "house.map"
    with create_map(path) as semantic_map:
        _mapped(semantic_map, furnished_house())
    assert main(["search", str(path), "apple", "--robot", "sim"]) == 0
    with open_map(path, read_only=True) as semantic_map:
        (record,) = semantic_map.searches.all()
        assert (record.state, record.started) == ("found", START)
        assert record.ended is not None and record.seconds > 10
        assert record.ended - record.started == pytest.approx(record.seconds, abs=1.0)
        assert len(semantic_map.searches.looks(record.iri)) <= 12
        (apple,) = semantic_map.objects("apple")
        assert record.found == (apple.iri,)
        assert float(np.linalg.norm(apple.p_map - HIDDEN.centre())) < 0.5
        (known, *_) = known_objects(semantic_map, resolve(semantic_map, ["apple"])[0])
        assert (known.iri, known.found_by, known.sure) == (apple.iri, record.iri, True)
        robot_now = semantic_map.robot()
        assert robot_now is not None
        assert robot_now.p_map[2] == 1.25  # the protocol tells no height: it stays


def test_maps_of_anything_but_the_demo_house_are_refused() -> None:
    with in_memory_map() as semantic_map:
        with pytest.raises(LayoutError, match="hereabouts demo"):
            simulated_robot(semantic_map)
        _mapped(semantic_map, furnished_house())
        simulated_robot(semantic_map)
        kitchen = RecordingRecord("my-kitchen", 1, "frame-000000", np.eye(4))
        semantic_map.apply(MapUpdate(recording=kitchen))
        before = semantic_map.sequence
        with pytest.raises(LayoutError, match="hereabouts demo"):
            simulated_robot(semantic_map)
        assert semantic_map.sequence == before
