"""A small map with everything that viewers draw."""

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import (
    FREE,
    TALL,
    FloorTile,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    Relation,
    RobotRecord,
)
from kg.serving.opening import in_memory_map


def thing(semantic_map, label, p_map, existence=1.0, **more):
    return ObjectRecord(
        iri=semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find(label, "object").iri,
        p_map=np.array(p_map),
        confidence=2.0,
        existence=existence,
        observations=4,
        first_seen=0.0,
        last_seen=10.0,
        **more,  # type: ignore[arg-type]
    )


@pytest.fixture
def kitchen() -> SemanticMap:
    """An L-shaped kitchen with a cup on a table, a doubtful chair, its floor, and the robot."""
    semantic_map = in_memory_map(title="our kitchen")
    table = thing(
        semantic_map, "dining table", (1, 1, 0.4), extent=np.array([1.2, 0.8, 0.8]), yaw=0.3
    )
    cup = thing(
        semantic_map, "cup", (1.1, 1, 0.85), 0.75, relations=(Relation("on", table.iri, 0.9),)
    )
    chair = thing(semantic_map, "chair", (3, 2, 0.4), existence=0.3)
    outline = (((0, 0), (4, 0), (4, 3), (2, 3), (2, 2), (0, 2)),)
    category = semantic_map.catalogue.find("kitchen", "place").iri
    cells = np.zeros((64, 64), np.uint8)
    cells[2:40, 2:20] = FREE
    cells[2, 2:20] = TALL
    semantic_map.apply(
        MapUpdate(
            objects=(table, cup, chair),
            places=(
                PlaceRecord(
                    semantic_map.place_iri(1),
                    "Küche",
                    0,
                    4,
                    0,
                    3,
                    5,
                    {category: 0.8},
                    outline=outline,
                ),
                PlaceRecord(semantic_map.place_iri(2), "place 2", 4, 7, 0, 3),
            ),
            robot=RobotRecord(np.array([2.0, 1.0, 1.2]), 0.5, 1000.25),
            floor=(FloorTile(0, 0, 0, 0.05, 0.05, cells, 1000.0),),
        )
    )
    return semantic_map
