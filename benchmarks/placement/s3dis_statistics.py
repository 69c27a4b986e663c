"""Write the room statistics that ship: counts of S3DIS (Apache-2.0), 156 rooms of offices.

    python benchmarks/placement/s3dis_statistics.py rooms_objects.csv
    kg/knowledge/placement/tables/s3dis.csv

Chairs, sofas (couches) and tables, the only objects of S3DIS that a detector of COCO's categories
knows; rooms under the names that ``kg/knowledge/placement/rooms.csv`` has. Deterministic.
"""

from __future__ import annotations

import csv
import sys
from collections import Counter
from pathlib import Path

from benchmarks.placement.buildings import load_s3dis
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies
from kg.knowledge.placement.statistics import COLUMNS


def main(table: Path, into: Path) -> None:
    """Count, and write the table."""
    catalogue = Catalogue.from_quads(load_ontologies().quads)
    rooms = [room for area in load_s3dis(table, catalogue) for room in area.rooms]
    number = Counter(room.name for room in rooms)
    held = Counter((room.name, thing) for room in rooms for thing in room.objects)
    things = sorted({thing for _, thing in held}, key=catalogue.label)
    with into.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name in sorted(number):
            for thing in things:
                row = (name, number[name], catalogue.label(thing), held[name, thing])
                writer.writerow(row)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
