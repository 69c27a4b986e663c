"""Data of the trial: evidence with statistics that leave out the tested building."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies
from kg.knowledge.placement.belief_model import EvidenceArrays, Matrix
from kg.knowledge.placement.evidence import PlacementEvidence, placement_evidence, room_counts
from kg.knowledge.placement.statistics import read_rooms, room_type_quads
from kg.knowledge.placement.surveys import RoomType, SurveyFeatures, room_types
from kg.model import vocabulary as v
from lab.placement.buildings import TrialBuilding, load_homes, load_s3dis
from lab.placement.fitting import TrainingSet

_STATISTICS: Final = frozenset({v.ROOM_COUNT, v.ROOMS_WITH_OBJECT, v.STATISTICS_PLACE})


@dataclass(frozen=True, slots=True)
class Sources:
    """The files a trial reads."""

    homes: Path  # folder of homes
    statistics: Path  # CSV of rooms
    s3dis: Path | None = None  # CSV of rooms of office buildings
    counted: bool | None = None  # whether the statistics count the homes too; None: if they can


@dataclass(frozen=True, slots=True)
class TrialData:
    """Buildings, and for each the evidence of all others; arrays (b, n, m) as in `TrainingSet`."""

    buildings: tuple[TrialBuilding, ...]  # homes first
    homes: int  # how many of them are homes; the rest are areas of S3DIS
    objects: Mapping[str, int]  # IRI -> row
    places: Mapping[str, int]  # IRI -> column
    sample: TrainingSet
    sought: NDArray[np.bool_]  # (b, n) the objects each building was searched for
    counted: bool  # whether the homes' own counts were taken out of the statistics


def load(sources: Sources) -> TrialData:
    """Read everything; raises InvalidFactError for files that are not of their form."""
    quads = [q for q in load_ontologies().quads if q.predicate.value != v.STATISTICS_OBJECT]
    quads = [q for q in quads if q.predicate.value not in _STATISTICS and not _counts(q.object)]
    shipped = Catalogue.from_quads(quads)
    homes = load_homes(sources.homes, shipped)  # first: the statistics may lie among them
    table = read_rooms(sources.statistics, shipped, "statistics")
    areas = load_s3dis(sources.s3dis, shipped) if sources.s3dis else ()
    quads.extend(room_type_quads({*table.new_types, *_new_types((*homes, *areas), shipped)}))
    known = placement_evidence(quads, Catalogue.from_quads(quads))
    rooms, held = room_counts(table.statistics, known.objects, known.places)
    return _assemble(known, (*homes, *areas), len(homes), (rooms, held), sources.counted)


def _counts(term: object) -> bool:
    return getattr(term, "value", "") == v.ROOM_STATISTICS


def _new_types(buildings: tuple[TrialBuilding, ...], catalogue: Catalogue) -> set[RoomType]:
    names = {room.name for building in buildings for room in building.rooms}
    return {kind for name in names for kind in room_types(name, catalogue) if kind.below}


def _assemble(
    known: PlacementEvidence,
    buildings: tuple[TrialBuilding, ...],
    homes: int,
    statistics: tuple[Matrix, Matrix],
    counted: bool | None,
) -> TrialData:
    own = [_own(building, known) for building in buildings]
    rows = np.flatnonzero(statistics[0].any(1))
    used = statistics[0].any(0) | np.any([rooms > 0 for rooms, _ in own], axis=0)
    used[known.places[v.PLACE]] = True
    columns = np.flatnonzero(used)
    cut = np.ix_(rows, columns)
    sought = np.ones((len(buildings), len(rows)), dtype=bool)
    if len(buildings) > homes:
        sought[homes:] = np.any([held.any(1) for _, held in own[homes:]], axis=0)[rows]
    held = np.array([held[cut] for _, held in own]) * sought[:, :, None]
    rooms = np.array([rooms[columns] for rooms, _ in own])[:, None, :] * sought[:, :, None]
    if counted is None:
        pairs = zip(statistics, (rooms, held), strict=True)
        counted = all(bool(np.all(its[:homes].sum(0) <= matrix[cut])) for matrix, its in pairs)
    elsewhere = [
        _elsewhere(matrix[cut], its, homes, counted)
        for matrix, its in zip(statistics, (rooms, held), strict=True)
    ]
    return TrialData(
        buildings,
        homes,
        {iri: n for n, iri in enumerate(_pick(known.objects, rows))},
        {iri: n for n, iri in enumerate(_pick(known.places, columns))},
        TrainingSet(_cut(known.evidence, rows, columns, *elsewhere), rooms, held),
        sought,
        counted,
    )


def _pick(index: Mapping[str, int], numbers: NDArray[np.intp]) -> list[str]:
    iris = list(index)
    return [iris[n] for n in numbers]


def _own(building: TrialBuilding, known: PlacementEvidence) -> tuple[Matrix, Matrix]:
    """(m,) rooms of one kind in a building, and (n, m) those that hold each object."""
    rooms, held = np.zeros(len(known.places)), np.zeros((len(known.objects), len(known.places)))
    for room in building.rooms:
        if len(room.places) == 1:
            rooms[known.places[room.places[0]]] += 1
            for thing in room.objects:
                held[known.objects[thing], known.places[room.places[0]]] += 1
    return rooms, held


def _elsewhere(statistics: Matrix, own: Matrix, homes: int, counted: bool) -> Matrix:
    """(b, n, m) counts of everything but the building: the table, and the other areas."""
    areas = own[homes:].sum(0)
    total = np.broadcast_to(statistics + areas, own.shape).copy()
    total[homes:] -= own[homes:]
    if counted:
        total[:homes] -= own[:homes]
    return np.asarray(np.maximum(total, 0.0))


def _cut_survey(survey: SurveyFeatures, cells: tuple[NDArray[np.intp], ...]) -> SurveyFeatures:
    arrays = (field.name for field in fields(survey) if field.name != "name")
    return replace(survey, **{name: getattr(survey, name)[cells] for name in arrays})


def _cut(
    evidence: EvidenceArrays,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    rooms: Matrix,
    held: Matrix,
) -> EvidenceArrays:
    cells = np.ix_(rows, columns)
    none = np.zeros((len(rows), len(columns)))
    return EvidenceArrays(
        listed=evidence.listed[cells],
        weight=evidence.weight[cells],
        surveys=tuple(_cut_survey(survey, cells) for survey in evidence.surveys),
        rooms=rooms,
        rooms_with=np.minimum(held, rooms),
        building_with=none,
        building_without=none,
        stated=none,
        statements=none,
    )
