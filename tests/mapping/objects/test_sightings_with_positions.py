"""Detections that have positions already, without a depth image."""

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import RobotRecord
from kg.serving.opening import in_memory_map
from mapping.frames.sighting import Sighting
from mapping.mapper import Mapper
from tests.mapping.objects.room import CUP, Room


def test_sightings_with_positions_are_objects_at_once(room):
    cup = room.map.catalogue.find("cup").iri
    (record,) = room.mapper.add_sightings(
        [Sighting(cup, 0.8, np.array([2.0, 0.0, 1.0]))], 1e9
    ).objects
    assert record.extent.max() == pytest.approx(0.1)
    (again,) = room.mapper.add_sightings(
        [Sighting(cup, 0.8, np.array([2.1, 0.0, 1.0]))], 1e9 + 1
    ).objects
    assert again.iri == record.iri
    assert again.existence > record.existence


def test_a_category_that_is_deleted_breaks_no_write(semantic_map):
    cup, bowl = (semantic_map.catalogue.find(name).iri for name in ("cup", "bowl"))
    mapper = Mapper(semantic_map)
    seen = [Sighting(cup, 0.9, np.zeros(3)), Sighting(bowl, 0.9, np.array([3.0, 0, 0]))]
    seen += [Sighting(cup, 0.9, np.array([6.0, 0, 0])), Sighting(bowl, 0.5, np.array([6.0, 0, 0]))]
    for n in range(3):
        mapper.add_sightings(seen, 1e9 + n)
    everything = f"DELETE WHERE {{ GRAPH graph:ontology {{ <{cup}> ?p ?o }} }}"
    semantic_map.update(everything, by="ann", allow=("ontology",))
    mapper.add_sightings([Sighting(bowl, 0.9, np.array([x, 0.02, 0])) for x in (0, 3, 6)], 1e9 + 9)
    assert [o.category for o in semantic_map.objects()] == [bowl] * 3


def test_sightings_with_positions_merge_as_frames_do(semantic_map):
    table = semantic_map.catalogue.find("dining table").iri
    mapper = Mapper(semantic_map)
    ends = [Sighting(table, 0.9, np.array([x, 0.0, 0.7])) for x in (0.0, 1.3, 4.0)]
    mapper.add_sightings(ends, 1e9)
    assert len(semantic_map.objects()) == 2  # a table is longer than 1.3 m, not than 2.7 m


def test_a_position_leaves_the_measured_extent_as_it_is(room: Room) -> None:
    room.see(CUP, times=3)
    measured = room.one.extent
    cup = room.one.category
    for n in range(20):
        room.mapper.add_sightings([Sighting(cup, 0.8, np.array([2.0, 0.0, 1.0]))], 1e9 + n)
    assert room.one.observations == 23
    np.testing.assert_array_equal(room.one.extent, measured)


def test_what_a_robot_sees_again_from_one_spot_counts_less(semantic_map: SemanticMap) -> None:
    sighting = Sighting(semantic_map.catalogue.find("cup").iri, 0.5, np.array([2.0, 0.0, 1.0]))

    def existence(step: float) -> float:
        other = in_memory_map()
        mapper = Mapper(other)
        for n in range(3):
            robot = RobotRecord(np.array([0.0, n * step, 1.0]), 0.0, 1e9 + n)
            mapper.add_sightings([sighting], 1e9 + n, robot=robot)
        (record,) = other.objects()
        return record.existence

    assert existence(0.0) < existence(0.5)
