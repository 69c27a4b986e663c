"""Tell whether an object is present, gone, was not seen, is hidden, or was never looked for.

Present: it was seen. Gone: it was there, and its spot was seen empty since. Looked, none seen: the
place was viewed, and none was ever known there. Hidden: one may stand where nobody viewed.
Never looked: almost nothing of the place was viewed, or no detector that mapped here has a name for
it. OBJECT is a category, a synonym, or one thing (object/17).

example: hereabouts status kitchen.map cup
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import (
    json_value,
    note,
    print_table,
    with_map,
    without_details,
    write,
    write_json,
)
from kg.model.shares import chance, percent

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from planner.search.goals.known_objects import KnownObject
    from planner.search.goals.status import Status


_ROWS: Final = 7  # places and things that are printed; --explain prints all
_OPTIONS = """
MAP
OBJECT ...           category or thing, e.g. cup or object/17
--in PLACE -> place  only in this place: label, number or IRI
--explain            print all places and things, what was seen close by, and the chances
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from planner.search.goals.place_names import spoken_places
    from planner.search.goals.status import stamp, status

    with open_map(arguments.map, read_only=True) as semantic_map:
        found = status(semantic_map, " ".join(arguments.object), arguments.place)
        doubted = _doubted(semantic_map, found, arguments.place)
        lines = _perhaps(semantic_map, found, doubted, arguments)
        called = {} if arguments.json else spoken_places(semantic_map)
    if arguments.json:
        plain = {name: json_value(value) for name, value in asdict(found).items()}
        write_json({**plain, "perhaps": [_doubted_json(one) for one in doubted]})
        return 0
    write(f"{found.target}: {found.value}. {found.proof[:1].upper()}{found.proof[1:]}.")
    for line in lines:
        write(with_map(f"{line}."))
    if found.places:
        table = (
            (
                "place",
                "status",
                "object",
                "sure",
                "last seen",
                "viewed",
                "close by",
                "last viewed",
                "noticed",
            ),
            [
                (
                    called.get(one.place or "", one.place_label).removeprefix("the "),
                    one.value,
                    one.label,
                    None if one.existence is None else chance(one.existence),
                    stamp(one.last_seen),
                    percent(one.viewed_share),
                    percent(one.closely_viewed_share),
                    stamp(one.last_viewed),
                    one.noticed,
                )
                for one in found.places
            ],
        )
        columns, rows = table if arguments.explain else without_details(*table)
        shown = rows if arguments.explain else rows[:_ROWS]
        print_table(columns, shown)
        if rest := len(rows) - len(shown):
            note(f"and {rest} more; --explain lists all")
    return 0


def _doubted(semantic_map: SemanticMap, found: Status, place: str | None) -> Sequence[KnownObject]:
    """Objects that were detected but more probably do not exist, if none is present."""
    from planner.search.goals.known_objects import known_objects
    from planner.search.goals.targets import resolve

    if found.value == "present" or "object/" in found.target or not found.detectable:
        return ()
    (target,) = resolve(semantic_map, (found.target,))
    chosen = None if place is None else semantic_map.resolve("place", place)
    return [
        one
        for one in known_objects(semantic_map, target)
        if one.doubted and chosen in (None, one.place)
    ]


def _perhaps(
    semantic_map: SemanticMap,
    found: Status,
    doubted: Sequence[KnownObject],
    arguments: argparse.Namespace,
) -> list[str]:
    from hereabouts.cli.candidates import detections_in_vain
    from planner.search.plans.answer_sentences import answer_lines

    if doubted:
        return answer_lines(doubted, time.time())
    if found.value == "present" or arguments.place is not None or not found.detectable:
        return []
    line = detections_in_vain(semantic_map, found.target)
    return [line] if line else []


def _doubted_json(one: KnownObject) -> dict[str, object]:
    return {
        "object": one.iri,
        "category": one.category,
        "existence": one.existence,
        "observations": one.observations,
        "where": one.where,
        "last_seen": None if one.last_seen is None else one.last_seen.isoformat(),
    }
