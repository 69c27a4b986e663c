"""List the rooms of a map, find them in its floor, or edit them: split, merge, draw, name, undo.

Without EDIT, the places are listed with their areas and neighbours. Points are x y in metres of the
map, with commas between them. Each edit is one transaction; its areas are assertions, which later
recordings respect.

  find                            makes rooms of the mapped floor places, divided at the doors;
                                  places that a user gave stay as they are
  split PLACE --points LINE       the smaller part becomes a new place, called --name
  merge PLACE PLACE               the first place gets the area of both
  wall PLACE PLACE --points LINE  divides the area of both anew
  draw --points CORNERS           a new place, called --name
  door PLACE PLACE --points POINT
  here --name NAME                names the place in which the robot stands
  undo                            takes one's own last edit back, then the one before

example: hereabouts rooms home.map split place/2 --points "3 0, 3 4" --name pantry --by ann
"""

from __future__ import annotations

import argparse

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import counted, note, notes_of, print_rows, write_json
from kg.model.room_edit import NEEDS, Point, RoomEdit

_COLUMNS = ("place", "label", "kind", "area m2", "adjacent")


_EDITS = ("find", *NEEDS)
_OPTIONS = f"""
MAP
[EDIT]                 {", ".join(_EDITS)}
[PLACE ...] -> places  place/1 or a full IRI
--points POINTS        metres: "3 0, 3 4"
--name NAME            name of the place
--by
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _OPTIONS,
        edit={"choices": _EDITS},
        points={"type": _points, "default": ()},
        name={"default": ""},
    )


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from kg.store.sparql_client import is_url

    if arguments.edit in (None, "find"):
        return _list(arguments)
    if arguments.by is None and not is_url(arguments.map):
        arguments.usage_error("an edit of rooms needs an author: --by NAME")
    edit = RoomEdit(arguments.edit, tuple(arguments.places), arguments.points, arguments.name)
    with open_map(arguments.map) as semantic_map:
        before = {place.iri: place for place in semantic_map.places()}
        change = semantic_map.rooms.edit(edit, by=arguments.by or "")
        after = {place.iri: place for place in semantic_map.places()}
        base, sequence = semantic_map.base, semantic_map.sequence
    changed = [iri for iri, place in after.items() if place != before.get(iri)]
    removed = sorted(before.keys() - after.keys())
    notes = notes_of(change, shown=not arguments.json)
    if arguments.json:
        write_json({"changed": changed, "removed": removed, "sequence": sequence, **notes})
        return 0
    for iri in changed:
        place = after[iri]
        new = "" if iri in before else " (new)"
        note(f"{iri.removeprefix(base)} {place.label}: {place.area.area:.1f} m2{new}")
    for iri in removed:
        note(f"{iri.removeprefix(base)} {before[iri].label}: removed")
    note(f"transaction {change.sequence}" if change else "nothing changed")
    return 0


def _list(arguments: argparse.Namespace) -> int:
    """List the places, after the rooms of the floor were made places if that is wanted."""
    from kg.serving.opening import open_map
    from mapping.places.found_places import find_places
    from planner.search.goals.place_names import in_brackets

    find = arguments.edit == "find"
    with open_map(arguments.map, read_only=not find, exclusive=find) as semantic_map:
        if find:
            find_places(semantic_map)
        labels = {place.iri: place.label for place in semantic_map.places()}
        base = semantic_map.base
        rows = [
            (
                place.iri.removeprefix(base),
                place.label,
                in_brackets(semantic_map.catalogue, place)[2:-1],
                round(place.area.area, 1),
                ", ".join(labels.get(iri, iri) for iri in place.adjacent),
            )
            for place in semantic_map.places()
        ]
        doors = len(semantic_map.doors())
    print_rows(_COLUMNS, rows, as_json=arguments.json)
    note(f"{counted(len(rows), 'place')}, {counted(doors, 'door')}")
    return 0


def _points(text: str) -> tuple[Point, ...]:
    try:
        pairs = [tuple(map(float, point.split())) for point in text.split(",")]
        return tuple((x, y) for x, y in pairs)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'points must be x y with commas between them, as in "3 0, 3 4", got {text[:80]!r}'
        ) from None
