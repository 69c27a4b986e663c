"""Validate, compare, reload or export an ontology, also of a map in use.

For ontologies that people edit, in Protege or by hand (docs/how-to/protege.md).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import MAP_HELP, add_command, declare
from hereabouts.cli.console import counted, note, print_table, write, write_json

if TYPE_CHECKING:
    from kg.knowledge.ontology.diff import OntologyChange

_SOURCE = "ontology file (Turtle, RDF/XML, N-Triples, JSON-LD) or folder; imports are followed"
_ANY = "ontology file or folder, folder of a map, or address of a server with a map"
_REASON = "--reason  ask HermiT for contradictions too (needs Java)"
_CHECK = f"""
[FILE|FOLDER ...] -> sources  {_SOURCE}
{_REASON}
--json
"""
_DIFF = f"""
OLD  {_ANY}
NEW  {_ANY}
--json
"""
_RELOAD = f"""
MAP        {MAP_HELP}, or the address of a running hereabouts serve
FILE|FOLDER -> source  {_SOURCE}
--by
--whole    remove terms that the file neither has nor imports
--dry-run  only print what would change
{_REASON}
--json
"""
_EXPORT = """
MAP
-o, --output FILE  .ttl, .owl, .rdf or .nt
"""
_WORDS = """
[WORD ...] -> words  only these words
-o, --output FILE    file to write (default: stdout)
"""


def add(parser: argparse.ArgumentParser) -> None:
    parts = parser.add_subparsers(dest="part", metavar="WHAT", required=True)
    for name, run, options in (
        ("check", _check, _CHECK),
        ("diff", _diff, _DIFF),
        ("reload", _reload, _RELOAD),
        ("export", _export, _EXPORT),
        ("words", _words, _WORDS),
    ):
        output = {"required": run is _export}
        declare(add_command(parts, name, run.__doc__ or "", run=run), options, output=output)


_MAX_PLACES = 50  # findings whose lines are looked for, which takes time in long files


def _check(arguments: argparse.Namespace) -> int:
    """Validate an ontology; list errors with file and line.

    Each is validated by itself (default: the shipped one): SHACL, vocabulary, rules of OWL 2 DL.
    Exit code 1 if a map would refuse one of them, 0 if there are only warnings.

    example: hereabouts ontology check mine.ttl --reason
    """
    from kg.knowledge.ontology.diagnostics import inspect, line_of
    from kg.knowledge.ontology.import_closure import load_with_imports
    from kg.model.resources import ONTOLOGIES
    from kg.serving.workers.updates import IsolatedParser

    rows: list[dict[str, object]] = []
    with IsolatedParser() as parse:
        for source in arguments.sources or [ONTOLOGIES]:
            ontology = load_with_imports(Path(source), parse)
            for finding in inspect(ontology, reason=arguments.reason):
                place = line_of(finding, ontology.files) if len(rows) < _MAX_PLACES else None
                file, line = place or ("", None)
                row = {"file": str(file), "line": line, **asdict(finding)}
                if row not in rows:  # an imported file is checked once for each importing file
                    rows.append(row)
    if arguments.json:
        write_json(rows)
    elif rows:
        columns = ("severity", "file", "line", "focus", "message", "value")
        table = [
            [Path(str(row["file"])).name if c == "file" else row[c] for c in columns]
            for row in rows
        ]
        print_table(("", "file", "line", "subject", "problem", "value"), table)
    wrong = sum(row["severity"] == "violation" for row in rows)
    note(f"{counted(wrong, 'error')}, {counted(len(rows) - wrong, 'warning')}")
    return 1 if wrong else 0


def _diff(arguments: argparse.Namespace) -> int:
    """Print the differences between two ontologies.

    Each addition (+), removal (-) and change (~) is a line.

    example: hereabouts ontology diff kitchen.map mine.ttl
    """
    from kg.knowledge.ontology.diff import changes
    from kg.knowledge.ontology.unused import unused_statements
    from kg.serving.reloading import ontology_at

    old, new = ontology_at(arguments.old), ontology_at(arguments.new)
    found = changes(old.quads, new.quads)
    for warning in (*new.findings, *unused_statements(new.quads)):
        note(str(warning))
    if arguments.json:
        write_json([asdict(change) for change in found])
    else:
        _print_changes(found)
    return 0


def _reload(arguments: argparse.Namespace) -> int:
    """Load an edited ontology into a map, also while it is served.

    It is validated and loaded in one transaction; what changes is printed. A refused ontology
    leaves the map as it is. Statements that people wrote into graph:commonsense stay. A running
    server needs its token in HEREABOUTS_TOKEN, its address in HEREABOUTS_SERVER.

    example: hereabouts ontology reload http://127.0.0.1:8008 mine.ttl
    """
    from kg.serving.reloading import reload

    done = reload(
        arguments.map,
        Path(arguments.source),
        by=arguments.by,
        whole=arguments.whole,
        reason=arguments.reason,
        dry=arguments.dry_run,
    )
    for warning in done.warnings:
        note(str(warning))
    if arguments.json:
        write_json({**asdict(done), "warnings": [asdict(w) for w in done.warnings]})
        return 0
    _print_changes(done.changes)
    for iri in done.kept:
        note(f"kept as the map has it: {iri}")
    if not arguments.dry_run and done.added + done.removed:
        note(f"transaction {done.sequence}: {done.added} triples added, {done.removed} removed")
    return 0


def _export(arguments: argparse.Namespace) -> int:
    """Write the present ontology of a map, with its imports, as one file that Protege opens.

    example: hereabouts ontology export kitchen.map -o kitchen.owl
    """
    from kg.export.serialization import export_ontology
    from kg.serving.opening import open_map

    output = Path(arguments.output)
    with open_map(arguments.map, read_only=True) as semantic_map:
        triples = export_ontology(semantic_map, output)
    note(f"wrote {output}: {triples:,} triples")
    return 0


def _words(arguments: argparse.Namespace) -> int:
    """Write household words as an ontology to import and edit.

    The words are classes below the shipped categories, with labels in English and German and links
    to WordNet (default: all words). After `ontology reload`, people can name things of a map by
    them.

    example: hereabouts ontology words keys wallet kettle -o mine.ttl
    """
    from kg.knowledge.ontology.catalogue import shipped_ontology
    from kg.knowledge.words.classes import vocabulary_turtle

    text = vocabulary_turtle(shipped_ontology().catalogue, arguments.words)
    return _write_page(text, arguments.output)


def _write_page(page: str, output: str | None) -> int:
    """Write a page to a file, or to stdout."""
    from kg.store.folder import write_atomically

    if output is None:
        write(page)
    else:
        write_atomically(Path(output), page)
        note(f"wrote {output}")
    return 0


def _print_changes(found: Iterable[OntologyChange]) -> None:
    lines = [str(change) for change in found]
    if lines:
        write("\n".join(lines))
    else:
        note("no differences")
