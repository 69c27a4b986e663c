"""Name things, so that their category is what people call them.

The name is asserted (`hereabouts retract MAP THING category` undoes it) and kept with its author. A
new word becomes a category below the nearest known one. `--review` writes a page with the pictures
of all things, those without a name first; what is typed there is saved to a file, which `--from`
reads.

example: hereabouts name kitchen.map object/17 "coffee machine" --by ann
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, print_table, write_json
from kg.model.errors import HereaboutsError, InvalidFactError
from kg.model.regular_files import read_text

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from kg.model.records import Assertion

_MAX_NAMES: Final = 5000  # of one file
_MAX_BYTES: Final = 2_000_000

Named = dict[str, str | None]  # a line of the answer, by field


_OPTIONS = """
MAP
[THING]     object/17, kitchen or a full IRI
[NAME ...]  name, as in coffee machine
"""

_MANY = """
--review FILE.html    write a page on which to name the things
--from FILE -> names  names: lines of THING,NAME
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)
    declare(parser.add_mutually_exclusive_group(), _MANY)
    declare(parser, "--by\n--json")


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from kg.store.folder import is_url

    single = arguments.thing is not None and bool(arguments.name)
    if arguments.thing is not None and not single:
        arguments.usage_error("a name is missing, as in: object/17 coffee machine")
    if single == bool(arguments.review or arguments.names):
        arguments.usage_error("give a THING and its NAME, or --review FILE.html, or --from FILE")
    if arguments.review:
        with open_map(arguments.map, read_only=True) as semantic_map:
            return _review(semantic_map, arguments)
    if arguments.by is None and not is_url(arguments.map):
        arguments.usage_error("a name needs an author: --by NAME")
    wanted = [(arguments.thing, " ".join(arguments.name))] if single else None
    wanted = _read(Path(arguments.names)) if wanted is None else wanted
    with open_map(arguments.map) as semantic_map:
        return _name(semantic_map, wanted, arguments)


def note_unnamed(semantic_map: SemanticMap, place: str | None = None) -> None:
    """A line about the things without a name in a map, or in a place (an IRI), if there are any."""
    from planner.search.goals.place_names import counted_unnamed

    if unnamed := counted_unnamed(semantic_map, place):
        note(f"and {unnamed}; `hereabouts name MAP --review FILE.html` shows them")


def _name(
    semantic_map: SemanticMap, wanted: list[tuple[str, str]], arguments: argparse.Namespace
) -> int:
    """Give each thing its name; the refused ones are listed, and the others are given."""
    done: list[Named] = []
    refused: list[Named] = []
    for thing, name in wanted:
        try:
            done.append(_named(semantic_map, thing, name, arguments.by or ""))
        except HereaboutsError as error:
            if len(wanted) == 1:
                raise
            refused.append({"thing": thing, "error": " ".join(str(error).split())})
    if arguments.json:
        write_json({"named": done, "refused": refused})
    else:
        for one in done:
            before = f", before: {one['before']} by {one['before_by']}" if one["before_by"] else ""
            kind = f", category {one['category']}" if one["category"] != one["name"] else ""
            note(f"{one['thing']}: {one['name']}{kind} (named by {one['by']}{before})")
        for one in refused:
            note(f"{one['thing']} is not named: {one['error']}")
    return 1 if refused else 0


def _named(semantic_map: SemanticMap, thing: str, name: str, by: str) -> Named:
    thing = semantic_map.resolve("iri", thing).removeprefix(semantic_map.base)
    former = _named_by(semantic_map, thing)
    before = None if former is None else _label(semantic_map, former.value)
    semantic_map.assertions.add(thing, "name", name, by=by)
    now = _named_by(semantic_map, thing)
    if now is None:
        raise InvalidFactError(f"the name of {thing} was retracted meanwhile")
    label = [a.value for a in semantic_map.assertions.all(thing) if a.property == "label"]
    changed = former is not None and former.value != now.value
    return {
        "thing": thing,
        "name": label[0] if label else _label(semantic_map, now.value),
        "category": _label(semantic_map, now.value),
        "iri": now.value if now.property == "category" else None,
        "by": now.by,
        "before": before if changed else None,
        "before_by": former.by if former is not None and changed else None,
    }


def _label(semantic_map: SemanticMap, iri: str) -> str:
    known = semantic_map.catalogue.by_iri(iri)
    return iri if known is None else known.label


def _named_by(semantic_map: SemanticMap, thing: str) -> Assertion | None:
    """What keeps the name of a thing: the category of an object, the label of a place."""
    from kg.maps.facts.assertions import NAME, kept_property

    kept, found = kept_property(NAME, thing), semantic_map.assertions.all(thing)
    return next((one for one in found if one.property == kept), None)


def _read(path: Path) -> list[tuple[str, str]]:
    """Things and names of a CSV file; lines without a name are left out."""
    try:
        text = read_text(path, "utf-8-sig", max_bytes=_MAX_BYTES)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
        raise InvalidFactError(f"cannot read names from {path}: {reason}") from error
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    odd = next((row for row in rows if len(row) != 2), None)
    if odd is not None or len(rows) > _MAX_NAMES:
        raise InvalidFactError(
            f"{path} is no list of names: each of up to {_MAX_NAMES} lines has THING,NAME, as in "
            "object/17,coffee machine"
        )
    named = [(thing.strip(), name) for thing, name in rows if name.strip()]
    if not named:
        raise InvalidFactError(f"{path} has no names; a line object/17,coffee machine would work")
    return named


def _review(semantic_map: SemanticMap, arguments: argparse.Namespace) -> int:
    from hereabouts.display.naming_sheet import MAX_THINGS, naming_sheet, things_to_name
    from kg.store.folder import write_atomically

    things = list(islice(things_to_name(semantic_map), MAX_THINGS))
    write_atomically(Path(arguments.review), naming_sheet(semantic_map, things))
    if arguments.json:
        write_json({"file": arguments.review, "things": [one.short for one in things]})
    else:
        nameless = sum(not one.named_by for one in things)
        note(
            f"{arguments.review}: {len(things)} things with pictures, {nameless} of them not named"
        )
        note("next: hereabouts name MAP --from names.csv --by YOU")
    return 0


_LABELS_OPTIONS = """
MAP
NAMES   names with commas between them, or a file with one a line
--json
"""


def add_labels(parser: argparse.ArgumentParser) -> None:
    declare(parser, _LABELS_OPTIONS)


def labels(arguments: argparse.Namespace) -> int:
    """Name things without a name by a list of one's own, as an encoder sees them.

    The map must be made with --encoder. Each thing without a name gets the name that it looks most
    like, if it looks like one. Names are asserted by "looks": `hereabouts retract MAP THING
    category` undoes one, and it is not made again.

    example: hereabouts labels kitchen.map "espresso machine, kettle, cutting board"
    """
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
