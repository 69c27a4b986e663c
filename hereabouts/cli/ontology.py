"""Validate, compare, reload or export an ontology, also of a map in use.

For ontologies that people edit, in Protege or by hand (docs/how-to/protege.md).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import MAP_HELP, add_author, add_json
from hereabouts.cli.console import counted, note, print_table, write, write_json

if TYPE_CHECKING:
    from kg.knowledge.ontology.diff import OntologyChange

    Parsers = argparse._SubParsersAction[argparse.ArgumentParser]

_SOURCE_HELP = "ontology file (Turtle, RDF/XML, N-Triples, JSON-LD) or folder; imports are followed"
_ANY_HELP = "ontology file or folder, folder of a map, or address of a server with a map"


def add(parser: argparse.ArgumentParser) -> None:
    parts = parser.add_subparsers(dest="part", metavar="WHAT", required=True)
    for add_part in (_add_check, _add_diff, _add_reload, _add_export, _add_vocabulary, _add_words):
        add_part(parts)


def _add_check(parts: Parsers) -> None:
    check = parts.add_parser(
        "check",
        help="validate an ontology; list errors with file and line",
        description="Validate ontologies, each by itself (default: the shipped one): SHACL, "
        "vocabulary, rules of OWL 2 DL. Exit code 1 if a map would refuse one of them, 0 if there "
        "are only warnings.",
        epilog="example: hereabouts ontology check mine.ttl --reason",
    )
    check.add_argument("sources", nargs="*", metavar="FILE|FOLDER", help=_SOURCE_HELP)
    _add_reason(check)
    add_json(check)
    check.set_defaults(run=_check)


def _add_diff(parts: Parsers) -> None:
    diff = parts.add_parser(
        "diff",
        help="differences between two ontologies",
        description="Print each addition (+), removal (-) and change (~) as a line.",
        epilog="example: hereabouts ontology diff kitchen.map mine.ttl",
    )
    diff.add_argument("old", metavar="OLD", help=_ANY_HELP)
    diff.add_argument("new", metavar="NEW", help=_ANY_HELP)
    add_json(diff)
    diff.set_defaults(run=_diff)


def _add_reload(parts: Parsers) -> None:
    reload = parts.add_parser(
        "reload",
        help="load an edited ontology into a map, also while it is served",
        description="Validate an ontology and load it into a map, in one transaction; print what "
        "changes. A refused ontology leaves the map as it is. Statements that people wrote into "
        "graph:commonsense stay. A running server needs its token in HEREABOUTS_TOKEN, its "
        "address in HEREABOUTS_SERVER.",
        epilog="example: hereabouts ontology reload http://127.0.0.1:8008 mine.ttl",
    )
    help_text = f"{MAP_HELP}, or the address of a running hereabouts serve"
    reload.add_argument("map", metavar="MAP", help=help_text)
    reload.add_argument("source", metavar="FILE|FOLDER", help=_SOURCE_HELP)
    add_author(reload)
    reload.add_argument(
        "--whole",
        action="store_true",
        help="remove terms that the file neither has nor imports",
    )
    reload.add_argument("--dry-run", action="store_true", help="only print what would change")
    _add_reason(reload)
    add_json(reload)
    reload.set_defaults(run=_reload)


def _add_export(parts: Parsers) -> None:
    export = parts.add_parser(
        "export",
        help="write a map's ontology as one file that Protege opens",
        description="Write the present ontology of a map, with its imports, as one file.",
        epilog="example: hereabouts ontology export kitchen.map -o kitchen.owl",
    )
    export.add_argument("map", metavar="MAP", help=MAP_HELP)
    export.add_argument(
        "-o", "--output", required=True, metavar="FILE", help=".ttl, .owl, .rdf or .nt"
    )
    export.set_defaults(run=_export)


def _add_vocabulary(parts: Parsers) -> None:
    vocabulary = parts.add_parser(
        "vocabulary",
        help="every term and category as a page (Markdown)",
        description="Print the vocabulary reference of an ontology (default: the shipped one).",
        epilog="example: hereabouts ontology vocabulary -o vocabulary.md",
    )
    vocabulary.add_argument("source", nargs="?", metavar="FILE|FOLDER", help=_SOURCE_HELP)
    vocabulary.add_argument(
        "-o", "--output", metavar="FILE", help="file to write (default: stdout)"
    )
    vocabulary.set_defaults(run=_vocabulary)


def _add_words(parts: Parsers) -> None:
    words = parts.add_parser(
        "words",
        help="household words as an ontology to import and edit",
        description="Write words as classes below the shipped categories, with labels in English "
        "and German and links to WordNet (default: all words). After `ontology reload`, people "
        "can name things of a map by them.",
        epilog="example: hereabouts ontology words keys wallet kettle -o mine.ttl",
    )
    words.add_argument("words", nargs="*", metavar="WORD", help="only these words")
    words.add_argument("-o", "--output", metavar="FILE", help="file to write (default: stdout)")
    words.set_defaults(run=_words)


def _add_reason(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--reason", action="store_true", help="ask HermiT for contradictions too (needs Java)"
    )


_MAX_PLACES = 50  # findings whose lines are looked for, which takes time in long files


def _check(arguments: argparse.Namespace) -> int:
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
    from kg.knowledge.ontology.diff import changes
    from kg.knowledge.ontology.unused import unused_statements
    from kg.serving.editing.reloading import ontology_at

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
    from kg.serving.editing.reloading import reload

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
    from kg.export.serialization import export_ontology
    from kg.serving.opening import open_map

    output = Path(arguments.output)
    with open_map(arguments.map, read_only=True) as semantic_map:
        triples = export_ontology(semantic_map, output)
    note(f"wrote {output}: {triples:,} triples")
    return 0


def _words(arguments: argparse.Namespace) -> int:
    from kg.knowledge.ontology.shipped import shipped_ontology
    from kg.knowledge.words.classes import vocabulary_turtle

    text = vocabulary_turtle(shipped_ontology().catalogue, arguments.words)
    return _write_page(text, arguments.output)


def _vocabulary(arguments: argparse.Namespace) -> int:
    from kg.knowledge.ontology.import_closure import load_with_imports
    from kg.knowledge.ontology.vocabulary_page import vocabulary_page
    from kg.model.resources import ONTOLOGIES
    from kg.serving.workers.updates import IsolatedParser

    with IsolatedParser() as parse:
        source = Path(arguments.source) if arguments.source else ONTOLOGIES
        ontology = load_with_imports(source, parse)
    return _write_page(vocabulary_page(ontology.quads), arguments.output)


def _write_page(page: str, output: str | None) -> int:
    """Write a page to a file, or to stdout."""
    from kg.store.atomic_file import write_atomically

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
