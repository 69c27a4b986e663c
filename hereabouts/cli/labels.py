"""Name things without a name by a list of one's own, as an encoder sees them.

The map must be made with --encoder. Each thing without a name gets the name that it looks most
like, if it looks like one. Names are asserted by "looks": `hereabouts retract MAP THING category`
undoes one, and it is not made again.

example: hereabouts labels kitchen.map "espresso machine, kettle, cutting board"
"""

from __future__ import annotations

import argparse
from dataclasses import asdict

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, print_table, write_json

_OPTIONS = """
MAP
NAMES   names with commas between them, or a file with one a line
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from mapping.looks.known_things import label_things
    from mapping.looks.user_encoder import given_words

    names = given_words(arguments.names)
    with open_map(arguments.map) as semantic_map:
        made = label_things(semantic_map, names)
        left = len(semantic_map.unnamed_things())
        base = semantic_map.base
    if arguments.json:
        write_json({"named": [asdict(one) for one in made], "unnamed": left})
        return 0
    rows = [(one.iri.removeprefix(base), one.name, round(one.likeness, 2)) for one in made]
    if rows:
        print_table(("thing", "looks like", "likeness"), rows)
    note(f"{len(made)} things have a name now, {left} have none")
    return 0
