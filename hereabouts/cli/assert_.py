"""Assert a property of an object or place; it outranks perception until retracted.

Objects have a category, position, extent, existence, label, and what they are on or inside; places
have a category, a label and a note. `hereabouts ask MAP conflicts` lists the assertions that
perception contradicts.

example: hereabouts assert kitchen.map object/17 category bowl --by ann
"""

from __future__ import annotations

import argparse
from typing import Final

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, notes_of, write_json

#: what `assert` and `retract` are about
THING = """
MAP
THING                 object/17, place/1, a label such as 'cup 2', or an IRI
PROPERTY -> property  property of the thing
"""
PROPERTIES: Final = (
    *("category", "position", "extent", "existence", "label", "name"),
    *("on", "inside", "area", "note"),
)
_OPTIONS = f"""
{THING}
VALUE ...             category: name or IRI; position: X Y Z in metres; extent: DX DY DZ in metres
                      and the box's YAW in radians; existence: present or absent; label, note: text;
                      on, inside: another object (object/3) or nothing; area: POLYGON ((x y, ...))
                      in metres
--by
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, property={"choices": PROPERTIES, "metavar": None})


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from kg.store.sparql_client import is_url
    from planner.search.goals.place_names import thing_named

    if arguments.by is None and not is_url(arguments.map):
        arguments.usage_error("an assertion needs an author: --by NAME")
    value, by = " ".join(arguments.value), arguments.by or ""
    with open_map(arguments.map) as semantic_map:
        thing = thing_named(semantic_map, arguments.thing)
        if arguments.property in ("on", "inside") and value != "nothing":
            value = thing_named(semantic_map, value)
        change = semantic_map.assertions.add(thing, arguments.property, value, by=by)
        # a name is a category with its own label
        stated = "category" if arguments.property == "name" else arguments.property
        (assertion,) = (a for a in semantic_map.assertions.all(thing) if a.property == stated)
        sequence = semantic_map.sequence
    if arguments.json:
        write_json(
            {
                "thing": assertion.subject,
                "property": assertion.property,
                "value": assertion.value,
                "by": assertion.by,
                "perceived": assertion.perceived,
                "contradicted": assertion.since is not None,
                "changed": change is not None,
                "sequence": sequence,
                **notes_of(change, shown=False),
            }
        )
        return 0
    done = f"transaction {change.sequence}" if change else "nothing changed"
    against = "; perception contradicts it" if assertion.since is not None else ""
    fact = f"{arguments.thing}: {arguments.property} is {value}"
    note(f"{fact} (asserted by {assertion.by}{against}); {done}")
    notes_of(change, shown=True)
    return 0
