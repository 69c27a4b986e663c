"""Family of attacks: maps of different coordinate frames, which are asked as if they were one."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import Target
from kg.maps.facts.coordinate_frames import frame_iri
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import create_map
from kg.serving.publishing.publisher import merged

ATTEMPTS: Final = 4
EVERYWHERE: Final = 1e9  # [m]
TOLERANCE: Final = 0.02  # [m]; positions are stored in centimetres
Matrix = NDArray[np.float64]


def attack(target: Target) -> Outcome:
    """Things near a place never include those of maps without a known transform, or elsewhere."""
    total = Outcome()
    for number in range(ATTEMPTS):
        folder = target.folder / f"frames-{number}"
        folder.mkdir()
        escapes = _escapes(folder, target.rng)
        total += Outcome(1, escapes, target.crashed())
    return total


@dataclass(slots=True)
class _Maps:
    """Maps in a folder, linked at random as a forest: each has a tree, and a frame in it."""

    folder: Path
    rng: random.Random
    bases: list[str] = field(default_factory=list)
    frames: list[tuple[int, Matrix]] = field(default_factory=list)  # tree and T_tree_map
    things: dict[str, tuple[int, Matrix]] = field(default_factory=dict)  # IRI: tree and point

    def add(self) -> None:
        """One more map of one cup."""
        rng, number = self.rng, len(self.bases)
        base = f"https://example.org/{number}-{rng.randrange(10**6)}/"
        point = np.array([rng.uniform(-50, 50), rng.uniform(-50, 50), 0.8])
        with create_map(self.folder / str(number), base=base, title=f"map {number}") as made:
            iri, kind = made.new_object_iri(), made.catalogue.find("cup").iri
            made.apply(MapUpdate((ObjectRecord(iri, kind, point, 1.0, 0.9, 5, 1e9, 1e9),)))
            self.frames.append(self._linked(made) if self.bases else (number, np.eye(4)))
        self.bases.append(base)
        tree, T_tree_map = self.frames[number]
        self.things[iri] = tree, _moved(T_tree_map, point)

    def _linked(self, made: SemanticMap) -> tuple[int, Matrix]:
        if self.rng.random() < 0.4:
            return len(self.bases), np.eye(4)
        parent, T_parent_map = self.rng.randrange(len(self.bases)), _transform(self.rng)
        made.place_frame(frame_iri(self.bases[parent]), T_parent_map, by="ann")
        tree, T_tree_parent = self.frames[parent]
        return tree, T_tree_parent @ T_parent_map

    def wrong(self, first: int) -> int:
        """Things that the map `first`, merged with the others, shows wrongly or leaves out."""
        order = sorted(range(len(self.bases)), key=lambda k: k != first)
        with merged([str(self.folder / str(k)) for k in order]) as together:
            view = together.in_one_frame(f"map {first}")
            found = {o.iri: o.p_map for o in view.objects(near=(0.0, 0.0), radius=EVERYWHERE)}
        tree, T_tree_first = self.frames[first]
        there = {iri: point for iri, (of, point) in self.things.items() if of == tree}
        there = {iri: _moved(np.linalg.inv(T_tree_first), point) for iri, point in there.items()}
        both = found.keys() & there.keys()
        moved = sum(math.dist(found[iri], there[iri]) > TOLERANCE for iri in both)
        return len(found.keys() ^ there.keys()) + moved


def _escapes(folder: Path, rng: random.Random) -> int:
    maps = _Maps(folder, rng)
    for _ in range(rng.randint(3, 5)):
        maps.add()
    return maps.wrong(rng.randrange(len(maps.bases)))


def _moved(T: Matrix, point: Matrix) -> Matrix:
    return np.asarray((T @ [*point, 1.0])[:3])


def _transform(rng: random.Random) -> Matrix:
    """A turn about the vertical and a shift [m], of map to parent."""
    angle = rng.choice((0.0, math.pi, rng.uniform(-4, 4)))
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = (rng.choice((0.0, rng.uniform(-1e3, 1e3))) for _ in range(3))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])
