"""Things without a name: found in several views, hidden in lists, kept once a person names them."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from mapping.places.place_registry import PlaceRegistry
from mapping.things.thing_mapper import FoundThing, ThingFinder, ThingMapper
from perception.frames import Frame
from tests.perception.conftest import look_at

VOXEL = 0.025
Solid = tuple[tuple[float, float, float], tuple[float, float, float]]

FLOOR: Solid = ((-2, -2, -0.1), (2, 2, 0))
WALL: Solid = ((-2, 2, 0), (2, 2.1, 2))
TABLE: Solid = ((-0.6, -0.4, 0.7), (0.6, 0.4, 0.75))
KETTLE: Solid = ((-0.1, -0.1, 0.75), (0.1, 0.1, 1.0))
JAR: Solid = ((0.1, -0.05, 0.75), (0.22, 0.05, 0.9))  # touches the kettle
BOX: Solid = ((1.0, 1.0, 0), (1.3, 1.3, 0.4))
FLYING: Solid = ((-0.5, -0.1, 1.1), (-0.3, 0.1, 1.25))
NOBODY = np.empty((0, 4), np.float32)
EYES = ((-0.8, -1.7, 1.6), (-0.3, -1.8, 1.7), (0.2, -1.8, 1.6), (0.7, -1.7, 1.7))


@functools.cache
def view(number: int, *solids: Solid, noise: float = 0.001) -> Frame:
    """What a camera in the eye of that number sees of `solids`, looking at the table."""
    eye = np.array(EYES[number])
    T = look_at(EYES[number], (0.2, 0.2, 0.7))
    K = np.array([[290.0, 0, 160], [0, 290, 120], [0, 0, 1]])
    v, u = np.mgrid[:240, :320]
    rays = np.stack([(u - 160) / 290, (v - 120) / 290, np.ones(u.shape)], -1) @ T[:3, :3].T
    depth = np.full(u.shape, np.inf)
    for low, high in solids:
        with np.errstate(divide="ignore"):
            ends = np.stack([(np.array(corner) - eye) / rays for corner in (low, high)])
        near, far = ends.min(0).max(-1), ends.max(0).min(-1)
        depth = np.where((near < far) & (near > 0), np.minimum(depth, near), depth)
    depth = np.where(np.isfinite(depth), depth, 0)
    depth += np.random.default_rng(number).normal(0, noise, depth.shape) * depth**2
    depth = depth.astype(np.float32)
    rgb = np.zeros((*depth.shape, 3), np.uint8)
    return Frame(f"frame-{number:06d}", rgb, depth, K, T, 100.0 + number)


def surface(*solids: Solid) -> Surface:
    blocks = []
    for low, high in solids:
        axes = [np.arange(a, b, VOXEL) + VOXEL / 2 for a, b in zip(low, high, strict=True)]
        blocks.append(np.stack(np.meshgrid(*axes, indexing="ij"), 3).reshape(-1, 3))
    points = np.concatenate(blocks).astype(np.float32)
    n = len(points)
    return Surface(
        VOXEL, points, np.zeros((n, 3), np.uint8), np.full(n, 9, np.uint16), np.full(n, 100.0)
    )


def found(*solids: Solid, noise: float = 0.001) -> list[FoundThing]:
    finder = ThingFinder()
    for number in range(len(EYES)):
        finder.add(view(number, *solids, noise=noise), NOBODY)
    return finder.found(surface(*solids))


@pytest.mark.parametrize("noise", [0.0005, 0.002])
def test_what_stands_on_a_table_and_on_the_floor_is_found(noise: float) -> None:
    things = found(FLOOR, WALL, TABLE, KETTLE, BOX, noise=noise)
    centres = sorted(tuple(one.box.centre.round(2)) for one in things)
    np.testing.assert_allclose(centres, [(0.0, 0.0, 0.88), (1.15, 1.15, 0.2)], atol=0.08)
    assert all(2 <= one.views <= len(EYES) and one.last_seen >= 101 for one in things)


def test_depth_in_64_bits_shows_the_same_things() -> None:
    solids, finder = (FLOOR, WALL, TABLE, KETTLE, BOX), ThingFinder()
    for number in range(len(EYES)):
        frame = view(number, *solids)
        finder.add(replace(frame, depth=frame.depth.astype(np.float64)), NOBODY)
    things = zip(finder.found(surface(*solids)), found(*solids), strict=True)
    assert [(a.box.centre == b.box.centre).all() for a, b in things] == [True, True]


def test_floors_walls_and_furniture_are_no_things() -> None:
    assert found(FLOOR, WALL, TABLE) == []
    assert ThingFinder().found(Surface.empty()) == []
    assert ThingFinder().found(surface(FLOOR)) == []


def test_things_that_touch_are_two() -> None:
    things = found(FLOOR, WALL, TABLE, KETTLE, JAR)
    centres = sorted(tuple(one.box.centre.round(2)) for one in things)
    np.testing.assert_allclose(centres, [(0.0, 0.0, 0.88), (0.16, 0.0, 0.83)], atol=0.06)


def test_a_thing_stands_on_something_level() -> None:
    (kettle,) = found(FLOOR, WALL, TABLE, KETTLE, FLYING)
    np.testing.assert_allclose(kettle.box.centre, (0, 0, 0.88), atol=0.08)


def test_a_single_view_is_not_enough() -> None:
    finder = ThingFinder()
    finder.add(view(1, FLOOR, WALL, TABLE, KETTLE), NOBODY)
    assert finder.found(surface(FLOOR, WALL, TABLE, KETTLE)) == []


def test_people_are_no_things() -> None:
    finder, everything = ThingFinder(), np.array([[0, 0, 320, 240]], np.float32)
    for number in range(len(EYES)):
        finder.add(view(number, FLOOR, TABLE, KETTLE), everything)
    assert finder.found(surface(FLOOR, TABLE, KETTLE)) == []


@pytest.fixture
def flat() -> SemanticMap:
    return in_memory_map(base="http://example.org/flat/")


def written(flat: SemanticMap, *solids: Solid, views: int = len(EYES)) -> None:
    """Map what cameras see of `solids`, as a recording of its own."""
    mapper = ThingMapper(flat, PlaceRegistry(flat, None, recording="r"), "r", pictures=False)
    for number in range(views):
        mapper.add(view(number, *solids), NOBODY)
    changes = mapper.changes(surface(*solids), flat.objects())
    flat.apply(MapUpdate(changes.updated, changes.removed))


def test_an_error_of_the_thread_that_looks_is_raised_to_who_asks(flat) -> None:
    mapper = ThingMapper(flat, PlaceRegistry(flat, None, recording="r"), "r", pictures=False)
    mapper.add(view(0, FLOOR, KETTLE), np.zeros((1, 3), np.float32))  # no box of a person
    with pytest.raises(ValueError, match="unpack"):
        mapper.changes(surface(FLOOR, KETTLE), ())
    mapper.add(view(1, FLOOR, KETTLE), NOBODY)
    assert mapper.changes(surface(FLOOR, KETTLE), ()).removed == (), "the next are looked at"


def test_things_are_in_no_list_of_objects_until_they_are_named(flat) -> None:
    written(flat, FLOOR, WALL, TABLE, KETTLE)
    (thing,) = flat.unnamed_things()
    assert flat.objects() == () and flat.objects(near=(0, 0)) == ()
    assert not flat.query("objects", least=0.0).rows
    flat.assertions.add(thing.iri, "category", "bottle", by="ann")
    assert [one.iri for one in flat.objects("bottle")] == [thing.iri]
    assert flat.unnamed_things() == () and flat.assertions.conflicts() == ()
    sequence = flat.sequence
    written(flat, FLOOR, WALL, TABLE, KETTLE)
    assert [one.iri for one in flat.objects("bottle")] == [thing.iri]
    assert flat.sequence == sequence  # the same views, the same facts
    written(flat, FLOOR, WALL, TABLE)
    assert [one.iri for one in flat.objects("bottle")] == [thing.iri]
    flat.assertions.retract(thing.iri, "category", by="ann")
    assert [one.iri for one in flat.unnamed_things()] == [thing.iri]


def test_a_thing_leaves_the_map_once_it_is_gone(flat) -> None:
    written(flat, FLOOR, WALL, TABLE, KETTLE)
    (thing,) = flat.unnamed_things()
    moved = ((-0.09, -0.1, 0.75), (0.11, 0.1, 1.0))
    written(flat, FLOOR, WALL, TABLE, moved)
    assert [one.iri for one in flat.unnamed_things()] == [thing.iri]
    written(flat, FLOOR, WALL, TABLE)
    assert flat.unnamed_things() == ()


def test_a_thing_stays_where_few_views_show_its_place(flat) -> None:
    written(flat, FLOOR, WALL, TABLE, KETTLE)
    (thing,) = flat.unnamed_things()
    written(flat, FLOOR, WALL, TABLE, KETTLE, views=1)
    assert [one.iri for one in flat.unnamed_things()] == [thing.iri]
    written(flat, FLOOR, WALL, TABLE, views=1)
    assert flat.unnamed_things() == ()


def test_what_is_a_named_object_is_no_thing(flat) -> None:
    cup = ObjectRecord(
        iri="http://example.org/flat/object/7",
        category=flat.catalogue.find("cup").iri,
        p_map=np.array([0.0, 0.0, 0.87]),
        confidence=1.0,
        existence=0.9,
        observations=3,
        first_seen=1.0,
        last_seen=2.0,
        extent=np.array([0.2, 0.2, 0.25]),
    )
    flat.apply(MapUpdate((cup,)))
    written(flat, FLOOR, WALL, TABLE, KETTLE)
    assert flat.unnamed_things() == ()


def test_why_tells_that_the_surface_shows_a_thing(flat) -> None:
    written(flat, FLOOR, WALL, TABLE, KETTLE)
    (thing,) = flat.unnamed_things()
    assert rules(flat, thing.iri) == ["found in the depth of several views"]
    assert rules(flat, f"{thing.iri} here:x")[0].startswith("the middle of the box")
    assert rules(flat, f"{thing.iri} here:existence")[0].startswith("n / (n + 3), where n")
    flat.assertions.add(thing.iri, "category", "bottle", by="ann")
    assert all("detector" not in rule for rule in rules(flat, thing.iri))
    flat.assertions.retract(thing.iri, "category", by="ann")
    written(flat, FLOOR, WALL, TABLE)
    assert rules(flat, thing.iri)[0].startswith("a thing without a name leaves the map when")


def rules(flat: SemanticMap, what: str) -> list[str]:
    """The rules in the explanations of `what`, each up to its first colon."""
    reasons = [step for one in flat.history.explain(what) for _, step in one.walk()]
    return [step.text.partition(":")[0] for step in reasons if step.kind == "rule"]
