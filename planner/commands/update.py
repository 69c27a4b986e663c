"""`hereabouts update`: SPARQL Update on the map."""

from __future__ import annotations

import argparse
from pathlib import Path

from planner.commands.arguments import add_json, add_map
from planner.commands.console import note, write_json


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "update",
        help="write to the map by SPARQL Update, checked and in one transaction",
        description="Apply SPARQL 1.1 Update. What would leave the map badly made is refused, "
        "and nothing is written then. A triple without GRAPH is one of graph:map.",
        epilog="example: hereabouts update kitchen.map --by ann "
        "-e 'INSERT DATA { <http://example.org/mine> a here:Cup ; here:x 1.2 ; here:y 0.4 }'",
    )
    add_map(parser)
    parser.add_argument("file", nargs="?", metavar="FILE.ru", help="file with the update")
    parser.add_argument("-e", "--execute", metavar="SPARQL", help="the update itself instead")
    parser.add_argument("--by", metavar="NAME", help="who writes")
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.error)


def run(arguments: argparse.Namespace) -> int:
    """Update, and say what changed."""
    from kg.semantic_map import SemanticMap

    if (arguments.file is None) == (arguments.execute is None):
        arguments.usage_error("give FILE.ru, or SPARQL with -e, not both")
    sparql = arguments.execute if arguments.file is None else _text(Path(arguments.file))
    with SemanticMap.open(arguments.map) as semantic_map:
        change = semantic_map.update(sparql, by=arguments.by)
        sequence = semantic_map.sequence
    added, removed = (len(change.added), len(change.removed)) if change else (0, 0)
    if arguments.json:
        write_json({"sequence": sequence, "added": added, "removed": removed})
    else:
        note(f"transaction {sequence}: {added} triples added, {removed} removed")
    return 0


def _text(path: Path) -> str:
    from kg.errors import QueryError

    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise QueryError(f"cannot read the update {path}: {error}") from error
