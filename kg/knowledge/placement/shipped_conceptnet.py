"""Shipped ConceptNet locations of objects, for ontologies without imported ones.

`tables/conceptnet.csv` has the weights that `hereabouts import conceptnet` finds in ConceptNet 4
for the shipped categories. The shipped ontologies contain only the relations of the thesis.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Final

from kg.knowledge.conceptnet.strength import probability_of
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.relations import Relation, RelationEvidence
from kg.model import vocabulary as v

TABLE: Final = Path(__file__).with_name("tables") / "conceptnet.csv"

SOURCE: Final = "ConceptNet 4 (CC BY-SA 4.0)"


def shipped_relations(catalogue: Catalogue) -> Iterator[Relation]:
    """A here:locatedAt for each row with two categories of the catalogue."""
    for thing, place, weight, against in _rows():
        subject, target = catalogue.get(thing, "object"), catalogue.get(place, "place")
        if subject is None or target is None:
            continue
        p = probability_of(max(weight - against, 0.0))
        evidence = RelationEvidence(p, (SOURCE,), weight, against, stated=False)
        yield Relation(v.LOCATED_AT, subject.iri, target.iri, p, (SOURCE,), (evidence,))


@lru_cache(maxsize=1)
def _rows() -> tuple[tuple[str, str, float, float], ...]:
    with TABLE.open(encoding="utf-8", newline="") as file:
        return tuple(
            (row["object"], row["place"], float(row["weight"]), float(row["weight_against"]))
            for row in csv.DictReader(file)
        )
