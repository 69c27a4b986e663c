"""Draw the map: places by category, and objects by name.

The picture is a PNG, SVG or PDF file. `hereabouts find MAP OBJECT --picture FILE` draws plans.

example: hereabouts plot kitchen.map -o map.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hereabouts.cli.arguments import add_map
from hereabouts.cli.console import note


def add(parser: argparse.ArgumentParser) -> None:
    add_map(parser)
    parser.add_argument(
        "-o",
        "--output",
        default="map.png",
        metavar="FILE",
        help="picture file (default: map.png)",
    )
    parser.add_argument(
        "--legend",
        choices=("class", "place"),
        default="class",
        help="give objects the colour and mark of their class, or of the category of their place "
        "(default: class)",
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="name objects of any existence (default: those below 0.5 are faint marks)",
    )


def run(arguments: argparse.Namespace) -> int:
    from hereabouts.display.plots.drawing import SHOWN_EXISTENCE
    from hereabouts.display.plots.map_plot import plot_map
    from kg.serving.opening import open_map

    output = Path(arguments.output)
    least = 0.0 if arguments.all else SHOWN_EXISTENCE
    with open_map(arguments.map, read_only=True) as opened:
        plot_map(opened.in_one_frame(), output, least=least, legend=arguments.legend)
    note(f"wrote {output}")
    return 0
