"""Placement table of a map, and import of room statistics into its ontology."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

from kg.knowledge.ontology.loading import compile_commonsense
from kg.knowledge.placement.belief_model import FITTED, PlacementParameters
from kg.knowledge.placement.statistics import RoomTable, statistics, statistics_quads, table_quads
from kg.knowledge.placement.table import PlacementTable, table_of
from kg.maps.query.evaluation import evaluate
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.transactions import Cause


def placement_table(
    semantic_map: SemanticMap,
    *,
    parameters: PlacementParameters = FITTED,
    sought: Collection[str] | None = None,
) -> PlacementTable:
    """Placement table of the map's present ontology, imported statistics and rooms.

    `sought` has the IRIs of the categories that the detector can detect (None: all). Only for these
    does a viewed room without such an object count against them. Raises OntologyError for an
    invalid ontology.
    """
    with semantic_map.hold():
        quads = semantic_map.engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH)
        return table_of(
            quads,
            semantic_map.places(),
            _placed_objects(semantic_map),
            catalogue=semantic_map.catalogue,
            parameters=parameters,
            sought=sought,
        )


@dataclass(frozen=True, slots=True)
class _PlacedObject:
    """The table reads these properties of an object."""

    category: str  # IRI
    place: str  # IRI
    existence: float


_PLACED: Final = """
SELECT ?thing ?kind ?place ?existence WHERE { GRAPH graph:map {
  ?thing here:inPlace ?place ; a ?kind ; here:x ?x OPTIONAL { ?thing here:existence ?existence }
} }"""


def _placed_objects(semantic_map: SemanticMap) -> Iterator[_PlacedObject]:
    """The objects in places, as `SemanticMap.objects` has them, without their other properties."""
    rows = evaluate(semantic_map.engine, _PLACED, shipped=True).rows
    by_iri, done = semantic_map.catalogue.by_iri, set[object]()
    for thing, kind, place, existence in sorted(rows, key=itemgetter(0, 1, 2)):
        category = by_iri(str(kind))
        if category is not None and category.kind != "place" and thing not in done:
            done.add(thing)
            if category.iri != v.UNNAMED_THING:
                given = 1.0 if existence is None else float(str(existence))
                yield _PlacedObject(category.iri, str(place), given)


def import_rooms(semantic_map: SemanticMap, table: RoomTable) -> int:
    """Import a table's statistics into a map's ontology; returns the number of changed triples.

    Statistics of the same source are replaced, in one transaction. A second import of the same
    table changes nothing.
    """
    sources = {one.source for one in table.statistics}
    with semantic_map.hold():
        stored = tuple(semantic_map.engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH))
        old = [one for one in statistics(stored) if one.source in sources]
        wanted = set(table_quads(table))
        gone = set(statistics_quads(old)) - wanted
        ontology = [q for q in stored if q not in gone]
        compiled = set(compile_commonsense([*ontology, *wanted]))
        compiled -= set(
            semantic_map.engine.quads_for_pattern(None, None, None, v.COMMONSENSE_GRAPH)
        )
        cause = Cause("import", "import rooms", "; ".join(sorted(sources)))
        change = semantic_map.store.commit(
            sorted(gone, key=str), sorted(wanted | compiled, key=str), cause
        )
        semantic_map.ontology.reread()  # new room types are categories from now on
    return len(change) if change else 0
