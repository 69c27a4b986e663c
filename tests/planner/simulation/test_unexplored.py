"""From pictures to a find: a robot searches a room that it had never entered."""

import math

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Rectangle
from kg.model.records import TALL
from kg.serving.opening import in_memory_map
from mapping.mapping_options import MappingOptions
from mapping.occupancy.mapped_floor import mapped_floor
from mapping.places.layout import Layout, LayoutPlace
from mapping.recording_mapper import map_recording
from planner.execution.options import SearchOptions
from planner.execution.search_loop import search
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import plan
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import House, HouseRoom, Item, Wall
from planner.simulation.house_robot import SimulatedHouseRobot, SimulatedTour, TimedPose
from planner.simulation.sensors import SimulatedDetector, SimulatedSceneClassifier

OAK = (0.76, 0.58, 0.40)
#: beside the door, so that it is not seen through it
TEDDY = Item("teddy bear", 6.7, 2.3, 0.0, "west")


def house() -> House:
    """A corridor and two rooms; nobody ever enters the one on the right."""
    return House(
        rooms=(
            HouseRoom(
                "corridor", "corridor", 0, 7, 0, 1.8, "planks", OAK, ((1.2, 0.9), (4.0, 0.9))
            ),
            HouseRoom("kitchen", "kitchen", 0, 3.4, 1.8, 5.6, "tiles", OAK, ((1.6, 3.4),)),
            HouseRoom("bedroom", "bedroom", 3.4, 7, 1.8, 5.6, "planks", OAK, ()),
        ),
        walls=(
            Wall((0, 0), (7, 0)),
            Wall((0, 5.6), (7, 5.6)),
            Wall((0, 0), (0, 5.6)),
            Wall((7, 0), (7, 5.6)),
            Wall((0, 1.8), (7, 1.8), doors=((1.1, 2.1), (4.0, 5.0))),
            Wall((3.4, 1.8), (3.4, 5.6)),
        ),
        objects=(
            Item("refrigerator", 0.42, 5.1, 0, "south"),
            Item("chair", 2.6, 4.8, 0, "south"),
            Item("bed", 5.4, 4.5, 0, "south"),
            TEDDY,
        ),
        furnishings=(),
    )


@pytest.fixture(scope="module")
def mapped() -> SemanticMap:
    """The map of a tour through corridor and kitchen, with these two as its places."""
    semantic_map = in_memory_map(title="a part of a house")
    camera = SimulatedCamera(house())
    places = [c.label for c in semantic_map.catalogue.categories if c.kind == "place"]
    known = house().rooms[:2]
    layout = Layout(
        tuple(
            LayoutPlace(n, r.name, Rectangle(r.xmin, r.xmax, r.ymin, r.ymax))
            for n, r in enumerate(known, 1)
        )
    )
    map_recording(
        SimulatedTour(camera),
        semantic_map,
        SimulatedDetector(camera),
        SimulatedSceneClassifier(camera, places),
        options=MappingOptions(layout=layout),
    )
    return semantic_map


def test_the_tour_maps_walls_where_walls_are(mapped: SemanticMap) -> None:
    floor = mapped_floor(mapped.floor())
    assert floor is not None
    at = np.argwhere(floor.states == TALL)
    spots = floor.origin + (at + 0.5) * floor.resolution
    walls = np.array([s for wall in house().walls for s in wall.solids()], object)
    fridge = house().objects[0].solids()
    off = [
        np.linalg.norm(np.maximum(np.maximum(s.lo[:2] - spots, spots - s.hi[:2]), 0), axis=1)
        for s in (*walls, *fridge)
        if s.lo[2] < 1.8
    ]
    nearest = np.min(off, axis=0)
    assert (nearest < 0.08).mean() > 0.97  # a cell and the noise of depth
    door = (abs(spots[:, 1] - 1.8) < 0.1) & (spots[:, 0] > 4.1) & (spots[:, 0] < 4.9)
    assert not door.any()


def test_the_room_nobody_entered_is_a_place_to_look(mapped: SemanticMap) -> None:
    assert not [o for o in mapped.objects() if "TeddyBear" in o.category]
    state = build_search(mapped, ["teddy bear"])
    assert state is not None
    beyond = [c for c in state.candidates if c.kind == "frontier"]
    assert beyond
    assert all(c.p_map[1] > 1.7 for c in beyond)  # behind the door, not behind walls
    found = plan(state, (4.0, 0.9), trials=0, worth=0.0)
    reasons = [reason.candidate.kind for step in found.steps for reason in step.why]
    assert "frontier" in reasons  # from where floor was seen, or beyond it


def test_a_robot_finds_what_is_only_there(mapped: SemanticMap) -> None:
    robot = SimulatedHouseRobot(house(), TimedPose(1.2, 0.9, 0.0, 0.0))
    outcome = search(
        mapped, ["teddy bear"], robot, SearchOptions(clock=lambda: 2e9 + robot.seconds)
    )
    assert outcome.state == "found"
    (spot,) = [o.p_map for o in mapped.objects() if o.iri in outcome.found]
    assert math.dist(spot[:2], TEDDY.centre()[:2]) < 0.4
    assert (robot.driven[:, 1] > 1.8).any()
