"""Change the map by SPARQL Update, validated and in one transaction.

An update that violates the SHACL shapes is refused as a whole. An update that deletes more than 10
objects and places, and more than a tenth of all, needs --yes. `hereabouts restore` undoes an
update. A triple without GRAPH belongs to graph:map.

example: hereabouts update kitchen.map --by ann -e 'INSERT DATA { <http://example.org/mine> a
here:Cup ; here:x 1.2 ; here:y 0.4 }'
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, notes_of, write_json

_OPTIONS = """
MAP
[FILE.ru] -> file     file with the update
-e, --execute SPARQL  the update as text
--by
--yes                 confirm that a large share of the map is deleted
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)


def run(arguments: argparse.Namespace) -> int:
    from kg.maps.stored_map import StoredMap
    from kg.serving.opening import open_map
    from kg.serving.workers.local_evaluation import update_isolated

    if (arguments.file is None) == (arguments.execute is None):
        arguments.usage_error("give FILE.ru, or SPARQL with -e, not both")
    sparql = arguments.execute if arguments.file is None else _text(Path(arguments.file))
    reasons: list[str] = []
    with open_map(arguments.map) as semantic_map:
        # a server evaluates updates in a worker of its own
        update = semantic_map.update
        if isinstance(semantic_map, StoredMap):
            update = partial(update_isolated, semantic_map, explain=reasons.append)
        change = update(sparql, by=arguments.by, confirmed=arguments.yes)
        sequence = semantic_map.sequence
    notes = notes_of(change, shown=not arguments.json)
    added, removed = (len(change.added), len(change.removed)) if change else (0, 0)
    if arguments.json:
        write_json({"sequence": sequence, "added": added, "removed": removed, **notes})
    elif change is None:
        note(f"nothing changed{''.join(f': {reason}' for reason in reasons if reason)}")
    else:
        note(f"transaction {sequence}: {added} triples added, {removed} removed")
    return 0


def _text(path: Path) -> str:
    from kg.model.errors import QueryError
    from kg.model.regular_files import read_text

    try:
        return read_text(path)
    except FileNotFoundError as error:
        given = " ".join(str(path).split())[:80]
        raise QueryError(
            f"cannot read the update {given!r}: no such file; give text with -e"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise QueryError(f"cannot read the update {path}: {error}") from error
