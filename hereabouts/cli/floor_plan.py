"""The plan of a map: its rooms, its floor as a grid, and its picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import count, declare
from hereabouts.cli.console import counted, note, notes_of, print_answer, write_json
from kg.model.errors import LayoutError
from kg.model.room_edit import NEEDS, Point, RoomEdit

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from mapping.occupancy.mapped_floor import MappedFloor

_COLUMNS = ("place", "label", "kind", "area m2", "adjacent")
_EDITS = ("find", *NEEDS)
_ROOMS_OPTIONS = f"""
MAP
[EDIT]                 {", ".join(_EDITS)}
[PLACE ...] -> places  kitchen, place/1 or a full IRI
--points POINTS        metres: "3 0, 3 4"
--name NAME            name of the place
--by
--json
"""


def add_rooms(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _ROOMS_OPTIONS,
        edit={"choices": _EDITS},
        points={"type": _points, "default": ()},
        name={"default": ""},
    )


def rooms(arguments: argparse.Namespace) -> int:
    """List the rooms of a map, find them in its floor, or edit them: split, merge, draw, undo.

    Without EDIT, the places are listed with their areas and neighbours. Points are x y in metres of
    the map, with commas between them. Each edit is one transaction; its areas are assertions, which
    later recordings respect. `hereabouts name MAP kitchen pantry --by ann` renames a room.

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
    from kg.serving.opening import open_map
    from kg.store.folder import is_url

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
    from planner.search.goals.place_names import likely_kind

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
                likely_kind(semantic_map.catalogue, place),
                round(place.area.area, 1),
                ", ".join(labels.get(iri, iri) for iri in place.adjacent),
            )
            for place in semantic_map.places()
        ]
        doors = len(semantic_map.doors())
    records = [dict(zip(_COLUMNS, row, strict=True)) for row in rows]
    end = len(_COLUMNS) if any(row[-1] for row in rows) else -1  # without doors none is adjacent
    print_answer(_COLUMNS[1:end], [row[1:end] for row in rows], arguments.json, records)
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


_FLOOR_OPTIONS = """
MAP
-o, --output FILE  YAML file to write
--storey N         number of the storey, in the order of mapping, from 0 (default: the robot's)
--at
--json
"""


def add_floor(parser: argparse.ArgumentParser) -> None:
    declare(parser, _FLOOR_OPTIONS, output={"required": True}, storey=count)


def floor(arguments: argparse.Namespace) -> int:
    """Write the mapped floor as an occupancy grid for ROS' map_server and Nav2.

    Two files are written: FILE.yaml and the image FILE.pgm.

    example: hereabouts floor kitchen.map -o floor.yaml
    """
    from kg.serving.opening import open_map
    from planner.freespace.map_server import write_grid

    output = Path(arguments.output)
    with open_map(arguments.map, read_only=True) as opened:
        semantic_map = opened.in_one_frame()
        if arguments.at is None:
            grid = _grid(semantic_map, arguments.storey)
        else:
            with semantic_map.at(arguments.at) as then:
                grid = _grid(then, arguments.storey)
    image = write_grid(grid, output)
    free, occupied = (round(float(a), 2) for a in grid.areas)
    if arguments.json:
        write_json(
            {
                "yaml": str(output),
                "image": str(image),
                "storey": grid.storey,
                "resolution": grid.resolution,
                "free_m2": free,
                "occupied_m2": occupied,
            }
        )
    else:
        note(f"wrote {output} and {image.name}: {free:.1f} m2 free, {occupied:.1f} m2 occupied")
    return 0


def _grid(semantic_map: SemanticMap, storey: int | None) -> MappedFloor:
    from mapping.occupancy.mapped_floor import mapped_floor

    robot = semantic_map.robot()
    height = None if robot is None else float(robot.p_map[2])
    tiles = semantic_map.floor()
    floor = mapped_floor(tiles, height, storey=storey)
    if floor is None:
        known = sorted({tile.storey for tile in tiles})
        if storey is not None and known:
            raise LayoutError(
                f"no floor is mapped on storey {storey}; mapped are: {', '.join(map(str, known))}"
            )
        raise LayoutError(
            f"{semantic_map.description.title!r} has no mapped floor; mapping a recording makes one"
        )
    return floor


_PLOT_OPTIONS = """
MAP
-o, --output FILE  picture file (default: map.png)
--legend           give objects the colour and mark of their class, or of the category of their
                   place (default: class)
--all              name objects of any existence (default: those below 0.5 are faint marks)
"""


def add_plot(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _PLOT_OPTIONS,
        output={"default": "map.png"},
        legend={"choices": ("class", "place"), "default": "class"},
    )


def plot(arguments: argparse.Namespace) -> int:
    """Draw the map: places by category, and objects by name.

    The picture is a PNG, SVG or PDF file. `hereabouts find MAP OBJECT --picture FILE` draws plans.

    example: hereabouts plot kitchen.map -o map.png
    """
    from hereabouts.display.plots.drawing import SHOWN_EXISTENCE
    from hereabouts.display.plots.map_plot import plot_map
    from kg.serving.opening import open_map

    output = Path(arguments.output)
    least = 0.0 if arguments.all else SHOWN_EXISTENCE
    with open_map(arguments.map, read_only=True) as opened:
        plot_map(opened.in_one_frame(), output, least=least, legend=arguments.legend)
    note(f"wrote {output}")
    return 0
