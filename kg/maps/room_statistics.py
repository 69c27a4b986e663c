"""Placement table of a map, and import of room statistics into its ontology."""

from __future__ import annotations

from collections.abc import Collection

from kg.knowledge.ontology.loading import compile_commonsense
from kg.knowledge.placement.settings import FITTED, PlacementParameters
from kg.knowledge.placement.statistics import RoomTable, statistics, statistics_quads, table_quads
from kg.knowledge.placement.table import PlacementTable, table_of
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
        places, objects = semantic_map.places(), semantic_map.objects()
        return table_of(
            quads,
            places,
            objects,
            catalogue=semantic_map.catalogue,
            parameters=parameters,
            sought=sought,
        )


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
