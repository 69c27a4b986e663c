"""Draw the map: places by category, and objects by name.

The picture is a PNG, SVG or PDF file. `hereabouts find MAP OBJECT --picture FILE` draws plans.

example: hereabouts plot kitchen.map -o map.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note

_OPTIONS = """
MAP
-o, --output FILE  picture file (default: map.png)
--legend           give objects the colour and mark of their class, or of the category of their
                   place (default: class)
--all              name objects of any existence (default: those below 0.5 are faint marks)
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _OPTIONS,
        output={"default": "map.png"},
        legend={"choices": ("class", "place"), "default": "class"},
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
