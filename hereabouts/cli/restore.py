"""Restore a past state of the map in a new transaction.

The history keeps both states, so a restoration can be undone too. The ontology is restored as well,
the number of the next object is not; --only restores a part. On a running server the author is the
holder of HEREABOUTS_TOKEN.

example: hereabouts restore kitchen.map --to '#254' --only objects --by ann
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import counted, note, write_json

if TYPE_CHECKING:
    from kg.maps.update.restoration import Restored


_OPTIONS = """
MAP
--to WHEN        #254 (the state after that transaction), or a time: 2026-08-01T12:30:00Z, yesterday
--only WHAT ...  objects, places, assertions, ontology, or one thing by IRI (repeatable)
--by
--yes            confirm that a large share of the map is deleted
--dry-run        only count what would change
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, to={"required": True})


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map

    with open_map(arguments.map) as semantic_map:
        done = semantic_map.restore(
            arguments.to,
            only=arguments.only,
            by=arguments.by,
            confirmed=arguments.yes,
            dry_run=arguments.dry_run,
        )
    if arguments.json:
        write_json({**asdict(done), "dry_run": arguments.dry_run})
        return 0
    for iri in done.skipped:
        note(f"{iri} is not in the map: assertions about it are not restored")
    note(_summary(done, arguments.dry_run))
    return 0


def _summary(done: Restored, dry_run: bool) -> str:
    if not done.added and not done.removed:
        return f"nothing differs from #{done.restored}; nothing was written"
    head = "dry run" if dry_run else f"transaction {done.sequence}"
    return (
        f"{head}, restores #{done.restored}: {done.added} triples added, {done.removed} removed; "
        f"{counted(done.objects_back, 'object')} back, {done.objects_gone} removed; "
        f"{counted(done.places_back, 'place')} back, {done.places_gone} removed"
    )
