"""Relation mapper: on, inside and beside relations of objects, updated as objects change.

Only objects that changed and those near them are computed again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from kg.knowledge.ontology.catalogue import carrier_kinds
from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord, Relation, RelationKind
from kg.model.usual_sizes import usual_sizes
from mapping.objects.object_cache import ObjectCache
from mapping.objects.object_mapper import ObjectChanges
from mapping.relations.probabilities import (
    Box,
    Boxes,
    BoxIndex,
    Carriers,
    Floats,
    RelationSettings,
    beside_probabilities,
    box_of,
    support_probabilities,
)

MOVED: Final = 0.03  # of its length, or 2 cm, by which a box moves before it is computed again
MAX_DISTANCE: Final = 1.0  # [m] between two boxes with a relation
FURNITURE: Final = 0.6  # [m] length from which on a support, as a chair or a table, is on the floor
MIN_PROBABILITY: Final = 0.2  # probability from which on a relation is kept
STEP: Final = 0.05  # by which a probability changes before it is written again
MAX_NEIGHBOURS: Final = 3  # of an object

_Relations = tuple[Relation, ...]


class RelationMapper:
    """Computes the relations of the objects in `objects`; writes nothing itself.

    Geometry is that of believed positions, so an asserted position moves a thing's relations too.
    """

    def __init__(self, semantic_map: SemanticMap, objects: ObjectCache) -> None:
        self._map, self._objects = semantic_map, objects
        self._settings = RelationSettings()
        self._boxes = BoxIndex()
        self._relations: dict[str, _Relations] = {}
        self._uncomputed = set(objects.perceived)  # since this run began
        self._read_ontology()
        for iri, record in objects.perceived.items():
            self._take(iri, record)

    def update(self, changes: ObjectChanges) -> ObjectChanges:
        """`changes`, with the relations that follow from them, of other objects too."""
        if self._catalogue is not self._map.catalogue:
            self._read_ontology()
        found, moved = dict[str, _Relations](), list[Box]()
        for iri in self._objects.take_changed():
            moved += self._moved(iri)
            if iri not in self._boxes and self._relations.get(iri):
                found[iri] = ()
        if moved:
            found |= self._computed(moved)
        written = {record.iri: record for record in changes.updated}
        perceived = self._objects.perceived
        for iri, relations in found.items():
            if {*relations} != {*self._relations.get(iri, ())}:
                self._relations[iri] = relations
                record = replace(written.get(iri, perceived[iri]), relations=relations)
                written[iri] = perceived[iri] = record
        return replace(changes, updated=tuple(written.values()))

    def of_things(self, things: Sequence[ObjectRecord]) -> tuple[ObjectRecord, ...]:
        """Records of other things, with their relations to objects; those of objects stay."""
        return tuple(replace(one, relations=self._of_thing(one)) for one in things)

    def _of_thing(self, thing: ObjectRecord) -> _Relations:
        box = box_of(replace(thing, existence=1.0), 0.0)
        if box is None:
            return ()
        near = [iri for iri in self._boxes.within([box], MAX_DISTANCE) if iri != thing.iri]
        names, boxes = [thing.iri, *near], [box, *(self._boxes[iri] for iri in near)]
        arrays = Boxes.of(boxes)
        on, inside, carriers = self._carried(names, boxes, arrays)
        found = list[Relation]()
        kinds: tuple[tuple[RelationKind, Floats], ...] = (("on", on[0]), ("inside", inside[0]))
        for kind, shares in kinds:
            if shares.max(initial=0.0) >= MIN_PROBABILITY:
                best = int(shares.argmax())
                found.append(self._relation(thing.iri, kind, names[carriers[best]], shares[best]))
        beside = beside_probabilities(arrays, self._settings)[0]
        beside[carriers] *= 1 - (on + inside)[0]
        for other in np.argsort(-beside, kind="stable")[:MAX_NEIGHBOURS].tolist():
            if beside[other] >= MIN_PROBABILITY:
                found.append(self._relation(thing.iri, "beside", names[other], beside[other]))
        return tuple(found)

    def _read_ontology(self) -> None:
        self._catalogue = self._map.catalogue
        self._kinds = carrier_kinds(self._map.ontology.quads())

    def _take(self, iri: str, record: ObjectRecord) -> None:
        if record.relations is not None:  # as the map has them
            self._relations[iri] = record.relations
        believed = self._objects.believed(record)
        usual = usual_sizes().get(self._catalogue.label(believed.category))
        self._boxes.put(iri, box_of(believed, usual.longest if usual else 0.0))

    def _moved(self, iri: str) -> list[Box]:
        """Former and present box of an object, unless they are much the same."""
        before, record = self._boxes.get(iri), self._objects.perceived.get(iri)
        if record is None:
            self._boxes.put(iri, None)
            self._relations.pop(iri, None)
            return [] if before is None else [before]
        if record.relations is not None and record.relations != self._relations.get(iri):
            self._uncomputed.add(iri)  # another writer has changed them
        self._take(iri, record)
        now = self._boxes.get(iri)
        computed = iri not in self._uncomputed
        self._uncomputed.discard(iri)
        much = max(MOVED * now.length, 0.02) if now is not None else 0.0
        if computed and before is not None and now is not None and not now.differs(before, much):
            self._boxes.put(iri, before)  # small steps add up
            return []
        return [box for box in (before, now) if box is not None]

    def _computed(self, moved: Sequence[Box]) -> dict[str, _Relations]:
        """Relations, by IRI, of all objects for which those of the `moved` boxes may matter.

        An object within reach of a box may relate to it. Objects within reach of that object may
        lose it as a neighbour.
        """
        near = list(self._boxes.within(moved, 4 * MAX_DISTANCE))
        inner = self._boxes.within(moved, 2 * MAX_DISTANCE)
        boxes = [self._boxes[iri] for iri in near]
        arrays = Boxes.of(boxes)
        on, inside, carriers = self._carried(near, boxes, arrays)
        found = {
            iri: [
                relation
                for relation in self._relations.get(iri, ())
                if relation.kind == "beside"
                and relation.target in self._boxes
                and relation.target not in inner
            ]
            for iri in near
            if iri in inner
        }
        kinds: tuple[tuple[RelationKind, Floats], ...] = (("on", on), ("inside", inside))
        for kind, shares in kinds:
            for row in np.nonzero(shares.max(axis=1, initial=0.0) >= MIN_PROBABILITY)[0].tolist():
                best = int(shares[row].argmax())
                target = near[carriers[best]]
                if near[row] in inner:
                    relation = self._relation(near[row], kind, target, shares[row, best])
                    found[near[row]].append(relation)
        carried = np.zeros((len(near), len(near)))
        carried[:, carriers] = on + inside
        alone = 1 - carried.sum(axis=1)
        together = carried @ carried.T + np.outer(alone, alone)  # on or in the same, or on nothing
        apart = (1 - carried) * (1 - carried.T)
        beside = beside_probabilities(arrays, self._settings) * together * apart
        for row, column in _mutual_neighbours(beside):
            one, other = near[row], near[column]
            if one in inner and other in inner:
                found[one].append(self._relation(one, "beside", other, beside[row, column]))
        return {iri: tuple(relations) for iri, relations in found.items()}

    def _carried(
        self, near: Sequence[str], boxes: Sequence[Box], arrays: Boxes
    ) -> tuple[Floats, Floats, list[int]]:
        """Probabilities (n, m) of on and inside, and the indices of the m carriers among the n."""
        kinds = self._kinds
        carriers = [
            i
            for i, box in enumerate(boxes)
            if box.category in kinds.supports or box.category in kinds.containers
        ]
        held = [boxes[i] for i in carriers]
        given = Carriers(
            Boxes.of(held),
            supports=np.array([box.category in kinds.supports for box in held], bool),
            contains=np.array([box.category in kinds.containers for box in held], bool),
            back=np.array([kinds.backs.get(box.category, 0.0) for box in held], np.float64),
        )
        others = np.arange(len(near))[:, None] != np.array(carriers, np.intp)[None, :]
        furniture = kinds.supports - kinds.containers
        on_floor = [box.category in furniture and box.length >= FURNITURE for box in boxes]
        allowed = others & ~np.array(on_floor, bool)[:, None]
        on, inside = support_probabilities(arrays, given, allowed, self._settings)
        return on, inside, carriers

    def _relation(self, iri: str, kind: RelationKind, target: str, share: float) -> Relation:
        """The relation, with the former probability where it is much the same."""
        for old in self._relations.get(iri, ()):
            if (old.kind, old.target) == (kind, target) and abs(old.probability - share) < STEP:
                return old
        return Relation(kind, target, round(float(share), 2))


def _mutual_neighbours(beside: Floats) -> Iterable[tuple[int, int]]:
    """(row, column) of pairs that are both among each other's most probable neighbours."""
    order = np.argsort(-beside, axis=1, kind="stable")[:, :MAX_NEIGHBOURS]
    among = np.zeros(beside.shape, bool)
    np.put_along_axis(among, order, True, axis=1)
    rows, columns = np.nonzero(among & among.T & (beside >= MIN_PROBABILITY))
    return zip(rows.tolist(), columns.tolist(), strict=True)
