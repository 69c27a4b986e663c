"""List what changed between two moments of the map.

Objects that appeared, are gone, moved or have another name, rooms that have another name or shape,
and the area of floor that was seen.
A moment is a time in ISO 8601 (UTC if it has no zone), words such as yesterday, 2h or now, or a
transaction: #42 is the state after the 42nd. Where the history begins later than T1, it counts from
there. A move counts if it is longer than the uncertainty of both positions and than --far.

example: hereabouts diff kitchen.map '#10' 2026-08-01T12:30:00Z
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare, moment_of
from hereabouts.cli.console import note, print_rows

if TYPE_CHECKING:
    from kg.history.replay.point_in_time import Difference
    from kg.history.reports.comparison import Comparison
    from kg.maps.semantic_map import SemanticMap

_COLUMNS = ("change", "thing", "category", "before", "after", "metres")
_FACTS = ("change", "subject", "predicate", "before", "after")


_OPTIONS = """
MAP
T1 -> before  first moment
T2 -> after   second moment
--moved       only objects that moved
--far M       shortest move [m] (default: 0.3)
--facts       all facts that changed instead
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, far={"type": float, "default": 0.3})


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from planner.questions.moments import read_since

    with open_map(arguments.map, read_only=True) as semantic_map:
        before = moment_of(arguments.before)
        is_now = arguments.after.strip().casefold() == "now"
        after = f"#{semantic_map.sequence}" if is_now else moment_of(arguments.after)
        history = semantic_map.history
        if arguments.facts:
            facts = read_since(semantic_map, before, lambda begin: history.diff(begin, after))
            return _facts(semantic_map, facts, arguments)
        found = read_since(
            semantic_map, before, lambda begin: history.compare(begin, after, far=arguments.far)
        )
    rows = _rows(found, only_moved=arguments.moved)
    print_rows(_COLUMNS, rows, as_json=arguments.json)
    note(f"#{found.before} to #{found.after}: {len(rows)} changes; {found.area_words}")
    return 0


def _rows(found: Comparison, *, only_moved: bool) -> list[tuple[object, ...]]:
    objects: list[tuple[object, ...]] = [
        (
            one.kind,
            one.iri,
            one.category,
            *one.sides,
            round(one.metres, 2) if one.kind == "moved" and one.metres is not None else None,
        )
        for one in found.changes
        if one.kind == "moved" or not only_moved
    ]
    rooms = [(one.kind, one.iri, one.title, one.before, one.after, None) for one in found.rooms]
    return objects if only_moved else [*objects, *rooms]


def _facts(semantic_map: SemanticMap, found: Difference, arguments: argparse.Namespace) -> int:
    print_rows(_FACTS, found.rows(semantic_map.base), as_json=arguments.json)
    note(
        f"#{found.before} to #{found.after}: {len(found.added)} triples added, "
        f"{len(found.removed)} removed"
    )
    return 0
