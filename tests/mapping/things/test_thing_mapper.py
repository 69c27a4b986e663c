"""Things without a name: found in the surface, hidden in lists, kept once a person names them."""

from __future__ import annotations

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from mapping.places.place_registry import PlaceRegistry
from mapping.things.thing_mapper import ThingMapper, things_of

VOXEL = 0.025


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """(n, 3) [m] voxels of a solid."""
    axes = [np.arange(a, b, VOXEL) + VOXEL / 2 for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), 3).reshape(-1, 3)


FLOOR = block((-2, -2, -0.025), (2, 2, 0))
WALL = block((-2, 2, 0), (2, 2.05, 2))
TABLE = block((-0.6, -0.4, 0.7), (0.6, 0.4, 0.75))
KETTLE = block((-0.1, -0.1, 0.75), (0.1, 0.1, 1.0))
BOX = block((1.0, 1.0, 0), (1.3, 1.3, 0.4))


def surface(*parts: np.ndarray) -> Surface:
    points = np.concatenate(parts).astype(np.float32)
    n = len(points)
    return Surface(
        VOXEL,
        points,
        np.zeros((n, 3), np.uint8),
        np.full(n, 9, np.uint16),
        np.full(n, 100.0),
    )


def test_what_stands_on_a_table_and_on_the_floor_is_found() -> None:
    found = things_of(surface(FLOOR, WALL, TABLE, KETTLE, BOX))
    centres = sorted(tuple(one.box.centre.round(1)) for one in found)
    assert len(found) == 2
    np.testing.assert_allclose(centres, [(0.0, 0.0, 0.9), (1.2, 1.2, 0.2)], atol=0.11)
    assert {one.frames for one in found} == {9}


def test_floors_walls_and_furniture_are_no_things() -> None:
    assert things_of(surface(FLOOR, WALL, TABLE)) == []
    assert things_of(Surface.empty()) == []


@pytest.fixture
def flat() -> SemanticMap:
    return in_memory_map(base="http://example.org/flat/")


def written(flat: SemanticMap, shown: Surface) -> None:
    mapper = ThingMapper(flat, PlaceRegistry(flat, None, recording="r"), "r", pictures=False)
    changes = mapper.changes(shown, flat.objects())
    flat.apply(MapUpdate(changes.updated, changes.removed))


def test_things_are_in_no_list_of_objects_until_they_are_named(flat) -> None:
    shown = surface(FLOOR, TABLE, KETTLE)
    written(flat, shown)
    (thing,) = flat.unnamed_things()
    assert flat.objects() == () and flat.objects(near=(0, 0)) == ()
    assert not flat.query("objects", least=0.0).rows
    flat.assertions.add(thing.iri, "category", "bottle", by="ann")
    assert [one.iri for one in flat.objects("bottle")] == [thing.iri]
    assert flat.unnamed_things() == () and flat.assertions.conflicts() == ()
    sequence = flat.sequence
    written(flat, shown)
    assert [one.iri for one in flat.objects("bottle")] == [thing.iri]
    assert flat.sequence == sequence  # the same surface, the same facts
    written(flat, surface(FLOOR, TABLE))
    assert [one.iri for one in flat.objects("bottle")] == [thing.iri]
    flat.assertions.retract(thing.iri, "category", by="ann")
    assert [one.iri for one in flat.unnamed_things()] == [thing.iri]


def test_a_thing_leaves_the_map_once_it_is_gone(flat) -> None:
    written(flat, surface(FLOOR, TABLE, KETTLE))
    (thing,) = flat.unnamed_things()
    moved = KETTLE + np.array([0.01, 0, 0])
    written(flat, surface(FLOOR, TABLE, moved))
    assert [one.iri for one in flat.unnamed_things()] == [thing.iri]
    written(flat, surface(FLOOR, TABLE))
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
    written(flat, surface(FLOOR, TABLE, KETTLE))
    assert flat.unnamed_things() == ()


def test_why_tells_that_the_surface_shows_a_thing(flat) -> None:
    written(flat, surface(FLOOR, TABLE, KETTLE))
    (thing,) = flat.unnamed_things()
    assert rules(flat, thing.iri) == ["found in the surface at the end of a mapping"]
    assert rules(flat, f"{thing.iri} here:x")[0].startswith("the middle of the box")
    assert rules(flat, f"{thing.iri} here:existence")[0].startswith("n / (n + 3), where n")
    flat.assertions.add(thing.iri, "category", "bottle", by="ann")
    assert all("detector" not in rule for rule in rules(flat, thing.iri))
    flat.assertions.retract(thing.iri, "category", by="ann")
    written(flat, surface(FLOOR, TABLE))
    assert rules(flat, thing.iri)[0].startswith("a thing without a name leaves the map when")


def rules(flat: SemanticMap, what: str) -> list[str]:
    """The rules in the explanations of `what`, each up to its first colon."""
    reasons = [step for one in flat.history.explain(what) for _, step in one.walk()]
    return [step.text.partition(":")[0] for step in reasons if step.kind == "rule"]
