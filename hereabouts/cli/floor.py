"""Write the mapped floor as an occupancy grid for ROS' map_server and Nav2.

Two files are written: FILE.yaml and the image FILE.pgm.

example: hereabouts floor kitchen.map -o floor.yaml
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import count, declare
from hereabouts.cli.console import note, write_json
from kg.model.errors import LayoutError

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from mapping.occupancy.mapped_floor import MappedFloor


_OPTIONS = """
MAP
-o, --output FILE  YAML file to write
--storey N         number of the storey, in the order of mapping, from 0 (default: the robot's)
--at
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, output={"required": True}, storey=count)


def run(arguments: argparse.Namespace) -> int:
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
