"""A made-up building of any size: rooms of 10 m x 10 m with a hundred objects each."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from pyoxigraph import Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord

BASE = "https://example.org/building/"
ROOM = 10.0  # [m]
A_ROOM = 100  # objects
PACE = 20 / 30  # objects that come into view from one frame to the next: all of them in a second
STAMP = 1_700_000_000.0  # [s]


class Building:
    """`size` objects, their places, and frames that see some of them again."""

    def __init__(self, size: int, catalogue: Catalogue, seed: int = 0) -> None:
        self.size = size
        self._random = np.random.default_rng(seed)
        self._objects = [c.iri for c in catalogue.categories if c.kind == "object"]
        self._rooms = [c.iri for c in catalogue.categories if c.kind == "place"]
        self._side = math.ceil(math.sqrt(math.ceil(size / A_ROOM)))  # rooms along one wall

    def places(self) -> Iterator[PlaceRecord]:
        """All places."""
        for number in range(math.ceil(self.size / A_ROOM)):
            west, south = (ROOM * n for n in divmod(number, self._side))
            likely, other = self._random.choice(len(self._rooms), 2, replace=False)
            beliefs = {self._rooms[likely]: 0.7, self._rooms[other]: 0.3}
            yield PlaceRecord(
                self._place(number), f"place {number + 1}", west, west + ROOM, south, south + ROOM,
                views=9, beliefs=beliefs,
            )  # fmt: skip

    def objects(self, numbers: Iterator[int] | range, *, seen: int = 1) -> Iterator[ObjectRecord]:
        """The objects of those numbers (0, 1, ...), each somewhere in its room."""
        for number in numbers:
            room = number // A_ROOM
            west, south = (ROOM * n for n in divmod(room, self._side))
            x, y, z = self._random.uniform((west, south, 0), (west + ROOM, south + ROOM, 2))
            stamp = STAMP + seen
            box = (10.0, 20.0, 30.0 + number % 99, 40.0)
            yield ObjectRecord(
                iri=f"{BASE}object/{number + 1}",
                category=self._objects[number % len(self._objects)],
                p_map=np.array([x, y, z]),
                confidence=float(self._random.uniform(0.1, 3.0)),
                existence=float(self._random.uniform(0.1, 1.0)),
                observations=seen,
                first_seen=STAMP,
                last_seen=stamp,
                place=self._place(room),
                evidence=Evidence(f"frame-{seen:06d}", "tour", stamp, box, 0.8, "net"),
            )

    def frame(self, number: int, seen: int = 20) -> MapUpdate:
        """Changes by a frame: `seen` neighbouring objects, at a random position, and the robot."""
        first = int(self._random.integers(0, max(1, self.size - seen)))
        return self._seen_from(first, number, seen)

    def drive(self, number: int, seen: int = 20) -> MapUpdate:
        """As `frame`, of a robot that drives from room to room instead of leaping.

        Most of what a frame sees the one before it saw as well; every number moves all the same.
        """
        return self._seen_from(int(number * PACE) % max(1, self.size - seen), number, seen)

    def _seen_from(self, first: int, number: int, seen: int) -> MapUpdate:
        objects = tuple(self.objects(range(first, first + seen), seen=number + 2))
        robot = RobotRecord(objects[0].p_map, 0.1 * (number % 60), STAMP + number)
        return MapUpdate(objects=objects, robot=robot)

    def centre(self) -> tuple[float, float]:
        """A point inside, in the middle of a room [m]."""
        column, row = divmod(math.ceil(self.size / A_ROOM) // 2, self._side)
        return ROOM * (column + 0.5), ROOM * (row + 0.5)

    def quads(self, facts: RecordCodec) -> Iterator[Quad]:
        """Everything as the writer of a map would store it, the next number counted up."""
        for place in self.places():
            yield from facts.of_place(place)
        for record in self.objects(range(self.size)):
            yield from facts.of_object(record)

    def furnish(self, semantic_map: SemanticMap, *, batch: int = 5000) -> None:
        """Put everything into a map, by its own writer."""
        semantic_map.apply(MapUpdate(places=tuple(self.places())))
        for start in range(0, self.size, batch):
            numbers = range(start, min(start + batch, self.size))
            semantic_map.apply(MapUpdate(objects=tuple(self.objects(numbers))))
        semantic_map.store.flush()

    def _place(self, number: int) -> str:
        return f"{BASE}place/{number + 1}"
