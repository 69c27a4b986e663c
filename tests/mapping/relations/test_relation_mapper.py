"""Which object is on, inside and beside which, as objects come, move and go."""

import math
from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from mapping.objects.object_cache import ObjectCache
from mapping.objects.object_mapper import ObjectChanges
from mapping.relations.probabilities import (
    Box,
    Boxes,
    Carriers,
    RelationSettings,
    support_probabilities,
)
from mapping.relations.relation_mapper import MAX_NEIGHBOURS, RelationMapper

TABLE = ("dining table", (0.0, 0.0, 0.4), (1.6, 0.9, 0.8))
CUP = ("cup", (0.3, 0.1, 0.8), (0.08, 0.08, 0.1))


class Room:
    """A map whose objects are written as a mapper would write them."""

    def __init__(self) -> None:
        self.map: SemanticMap = in_memory_map(base="http://example.org/lab/")
        self.cache = ObjectCache(self.map)
        self.relations = RelationMapper(self.map, self.cache)

    def put(self, label, position, extent, **fields):
        record = ObjectRecord(
            iri=self.map.new_object_iri(),
            category=self.map.catalogue.find(label).iri,
            p_map=np.array(position),
            confidence=3.0,
            existence=0.9,
            observations=5,
            first_seen=10.0,
            last_seen=10.0,
            extent=np.array(extent),
            deviation=0.03,
        )
        return self.change(replace(record, **fields))  # type: ignore[arg-type]

    def change(self, record: ObjectRecord) -> str:
        self.cache.update({record.iri: record})
        self.write(ObjectChanges((record,)))
        return record.iri

    def remove(self, iri: str) -> None:
        self.cache.remove([iri])
        self.write(ObjectChanges(removed=(iri,)))

    def write(self, changes: ObjectChanges) -> None:
        changes = self.relations.update(changes)
        self.map.apply(MapUpdate(objects=changes.updated, removed=changes.removed))

    def related(self, iri: str, kind: str) -> list[str]:
        rows = self.map.query(f"SELECT ?b WHERE {{ <{iri}> here:{kind} ?b }} ORDER BY ?b").rows
        return [str(row[0]) for row in rows]


@pytest.fixture
def room() -> Room:
    return Room()


def test_a_cup_is_on_the_table_that_was_mapped_before_or_after_it(room: Room) -> None:
    table = room.put(*TABLE)
    cup = room.put(*CUP)
    assert room.related(cup, "on") == [table]
    room.remove(table)
    assert room.related(cup, "on") == []
    assert room.related(cup, "on") == [] != [room.put(*TABLE)]
    assert len(room.related(cup, "on")) == 1


def test_what_moves_away_loses_the_relation_and_what_the_support_carries_does(room: Room) -> None:
    table, cup = room.put(*TABLE), room.put(*CUP)
    record = room.cache.perceived[cup]
    room.change(replace(record, p_map=np.add(record.p_map, [3.0, 0.0, 0.0])))
    assert room.related(cup, "on") == []
    room.change(record)
    assert room.related(cup, "on") == [table]
    moved = room.cache.perceived[table]
    room.change(replace(moved, p_map=np.add(moved.p_map, [0.0, 4.0, 0.0])))
    assert room.related(cup, "on") == []


def test_what_is_not_believed_to_exist_takes_no_part(room: Room) -> None:
    table, cup = room.put(*TABLE), room.put(*CUP)
    room.change(replace(room.cache.perceived[cup], existence=0.4))
    assert room.related(cup, "on") == []
    room.change(replace(room.cache.perceived[cup], existence=0.6))
    assert room.related(cup, "on") == [table]
    room.change(replace(room.cache.perceived[table], existence=0.3))
    assert room.related(cup, "on") == []


def test_an_underside_a_little_below_the_top_of_a_box_is_likeliest() -> None:
    """What else stands on a table raises the top of its box."""
    table = Box(np.array([-0.8, -0.45, 0.0]), np.array([0.8, 0.45, 0.8]), 0.03, "table", 1.6)
    at = (0.6, 0.7, 0.8, 0.9)
    cups = [Box(np.array([0, 0, z]), np.array([0.1, 0.1, z + 0.1]), 0.03, "cup", 0.1) for z in at]
    carriers = Carriers(Boxes.of([table]), np.array([True]), np.array([False]), np.zeros(1))
    every = np.ones((len(cups), 1), bool)
    shares, _ = support_probabilities(Boxes.of(cups), carriers, every, RelationSettings())
    assert shares[:, 0].argmax() == 1
    assert shares[0, 0] == pytest.approx(shares[2, 0])


def test_a_chair_at_a_table_is_on_nothing_and_so_is_a_bag_below_it(room: Room) -> None:
    room.put(*TABLE)
    chair = room.put("chair", (0.3, 0.5, 0.45), (0.45, 0.45, 0.9))
    bag = room.put("backpack", (-0.2, 0.0, 0.2), (0.3, 0.2, 0.4))
    assert room.related(chair, "on") == room.related(bag, "on") == []


@pytest.mark.parametrize(
    ("label", "extent"),
    [
        ("dining table", (1.2, 0.7, 0.3)),
        ("chair", (0.45, 0.45, 0.5)),
        ("couch", (1.0, 0.6, 0.4)),
        ("bed", (1.0, 0.6, 0.4)),
        ("bench", (1.0, 0.4, 0.4)),
    ],
)
def test_furniture_is_on_no_other_where_boxes_overlap(room, label, extent):
    room.put(*TABLE)
    above = room.put(label, (0.1, 0.1, 0.7 + extent[2] / 2), extent)
    cup = room.put("cup", (0.1, 0.1, 0.75 + extent[2]), (0.08, 0.08, 0.1))
    assert room.related(above, "on") == []
    assert len(room.related(cup, "on")) == 1
    microwave = room.put("microwave", (-0.5, 0.0, 0.9), (0.5, 0.35, 0.3))
    assert len(room.related(microwave, "on")) == 1  # what contains things may stand on others


def test_a_teddy_bear_sits_on_the_seat_of_a_couch_below_its_back(room: Room) -> None:
    couch = room.put("couch", (0.0, 0.0, 0.42), (1.8, 0.9, 0.84))
    bear = room.put("teddy bear", (0.2, 0.0, 0.6), (0.2, 0.2, 0.35))
    assert room.related(bear, "on") == [couch]


def test_an_apple_in_a_bowl_on_a_table_is_inside_the_bowl(room: Room) -> None:
    table = room.put(*TABLE)
    bowl = room.put("bowl", (0.0, 0.0, 0.84), (0.25, 0.25, 0.12))
    apple = room.put("apple", (0.02, 0.0, 0.84), (0.08, 0.08, 0.08))
    assert room.related(apple, "inside") == [bowl]
    assert room.related(apple, "on") == []
    assert room.related(bowl, "on") == [table]


def test_beside_is_symmetric_and_bounded(room: Room) -> None:
    cups = [room.put("cup", (0.15 * n, 0.0, 0.8), (0.08, 0.08, 0.1)) for n in range(8)]
    beside = {cup: room.related(cup, "beside") for cup in cups}
    assert all(cup in beside[other] for cup in cups for other in beside[cup])
    assert 1 <= max(map(len, beside.values())) <= MAX_NEIGHBOURS
    far = room.put("cup", (5.0, 0.0, 0.8), (0.08, 0.08, 0.1))
    low = room.put("cup", (0.3, 0.1, 0.05), (0.08, 0.08, 0.1))
    assert room.related(far, "beside") == room.related(low, "beside") == []


def test_a_chair_at_a_table_is_not_beside_a_cup_on_it(room: Room) -> None:
    room.put(*TABLE)
    cup = room.put("cup", (0.3, 0.35, 0.85), (0.1, 0.1, 0.1))
    other = room.put("cup", (0.1, 0.35, 0.85), (0.1, 0.1, 0.1))
    room.put("chair", (0.3, 0.65, 0.8), (0.35, 0.2, 0.2))
    assert room.related(cup, "beside") == [other]


@pytest.mark.parametrize("extent", [(np.nan, 1.0, 1.0), (np.inf, 1.0, 1.0), (1e300, 1e300, 1e300)])
def test_boxes_that_cannot_be_do_no_harm(room: Room, extent: tuple[float, ...]) -> None:
    room.put(*TABLE)
    strange = ObjectRecord(
        iri=room.map.new_object_iri(),
        category=room.map.catalogue.find("bed").iri,
        p_map=np.zeros(3),
        confidence=1.0,
        existence=1.0,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
        extent=np.array(extent),
    )
    room.cache.update({strange.iri: strange})
    room.write(room.relations.update(ObjectChanges()))
    assert len(room.related(room.put(*CUP), "on")) == 1


def test_each_change_gives_what_a_fresh_start_gives(room: Room) -> None:
    random = np.random.default_rng(4)
    iris = [room.put(*TABLE)]
    labels = ("cup", "bowl", "book", "chair", "apple")
    for number in range(40):
        x, y = random.uniform(-2, 2, 2)
        z, label = random.choice([0.1, 0.8]), labels[number % 5]
        iris.append(room.put(label, (x, y, z), tuple(random.uniform(0.05, 0.4, 3))))
    for iri in random.choice(iris[1:], 15, replace=False):
        record = room.cache.perceived[iri]
        room.change(replace(record, p_map=record.p_map + random.uniform(-1, 1, 3) * [1, 1, 0]))
    for iri in random.choice(iris[1:], 5, replace=False):
        room.remove(iri)

    fresh = RelationMapper(room.map, room.cache)
    room.cache.update(dict(room.cache.perceived))
    again = fresh.update(ObjectChanges())
    before = {r.iri: {(x.kind, x.target) for x in r.relations or ()} for r in room.map.objects()}
    after = {r.iri: {(x.kind, x.target) for x in r.relations or ()} for r in again.updated}
    assert {iri: after.get(iri, held) for iri, held in before.items()} == before
    assert sum(map(len, before.values())) > 20


def test_a_restarted_mapper_keeps_and_repairs_relations(room: Room) -> None:
    table, cup = room.put(*TABLE), room.put(*CUP)
    room.cache = ObjectCache(room.map)
    room.relations = RelationMapper(room.map, room.cache)
    assert room.map.apply(MapUpdate(objects=room.relations.update(ObjectChanges()).updated)) is None
    room.remove(table)
    assert room.related(cup, "on") == []


def test_an_asserted_position_moves_the_relations(room: Room) -> None:
    table, cup = room.put(*TABLE), room.put(*CUP)
    room.map.assertions.add(cup, "position", (4.0, 4.0, 0.8), by="ann")
    room.cache.refresh()
    room.write(ObjectChanges())
    assert room.related(cup, "on") == []
    room.map.assertions.retract(cup, "position")
    room.cache.refresh()
    room.write(ObjectChanges())
    assert room.related(cup, "on") == [table]


def test_a_kind_of_table_carries_what_tables_carry(room: Room) -> None:
    room.map.update(
        "INSERT DATA { GRAPH graph:ontology { here:Sideboard a owl:Class ; "
        'rdfs:label "sideboard" ; rdfs:comment "Low." ; rdfs:subClassOf here:DiningTable } }',
        by="ann",
        allow=("ontology",),
    )
    sideboard = room.put("sideboard", TABLE[1], TABLE[2])
    assert room.related(room.put(*CUP), "on") == [sideboard]


def test_a_turned_table_carries_what_lies_over_it_and_not_beside_its_corners(room: Room) -> None:
    label, position, extent = TABLE
    table = room.put(label, position, extent, yaw=math.pi / 4)
    over = room.put("cup", (0.5, 0.5, 0.85), (0.08, 0.08, 0.1))
    off = room.put("bowl", (0.5, -0.5, 0.85), (0.2, 0.2, 0.1))
    assert room.related(over, "on") == [table]
    assert room.related(off, "on") == []
    room.change(replace(room.cache.perceived[table], yaw=-math.pi / 4))
    assert room.related(over, "on") == []
    assert room.related(off, "on") == [table]


def test_turned_things_are_beside_one_another_by_the_gap_between_them(room: Room) -> None:
    sofa = room.put("couch", (0.0, 0.0, 0.4), (2.0, 0.8, 0.8), yaw=math.pi / 4)
    near = room.put("couch", (-0.75, 0.75, 0.4), (2.0, 0.8, 0.8), yaw=math.pi / 4)
    far = room.put("couch", (1.4, -1.4, 0.4), (2.0, 0.8, 0.8), yaw=math.pi / 4)
    assert room.related(sofa, "beside") == [near]
    assert room.related(far, "beside") == []
