"""`hereabouts import conceptnet`: relations of the categories as an ontology file."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import add_command, declare
from hereabouts.cli.console import note, print_table, progress, write_json
from kg.model.vocabulary import shorten

if TYPE_CHECKING:
    from kg.knowledge.conceptnet.importing import ConceptNetImport
    from kg.knowledge.conceptnet.relate import ImportedRelation
    from kg.knowledge.conceptnet.turtle import RelationChange

_FOUND = ("what", "", "where", "p", "weight", "against", "wording")
_CHANGES = ("change", "what", "", "where", "p before", "p after")
_WORDS = {"locatedAt": "located at", "nearBy": "near", "subClassOf": "is a"}


_OPTIONS = """
--from URL|FILE -> source  assertions of ConceptNet 5 (TSV) or graph of ConceptNet 4, plain or gzip,
                        or the address of a web API (http://api.conceptnet.io)
--into FILE.ttl         Turtle file to write or bring up to date
--review FILE.csv       table to write: each relation with the sentences it comes from, the weakest
                        first. Change yes to no in its column keep and import again: the relation is
                        dropped for good
--language LANGUAGE     language of the assertions (default: en)
--ontologies DIR        folder of ontologies (default: the shipped ones)
--dry-run               print what would change, write nothing
--cache DIR             folder that caches answers of the web API (default: in the user's cache
                        folder)
--json
"""


def add(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = add_command(kinds, "conceptnet", run.__doc__ or "", run=run)
    declare(parser, _OPTIONS, source={"required": True}, language={"default": "en"})


def run(arguments: argparse.Namespace) -> int:
    """Read where things are found, from ConceptNet (file or web API).

    LocatedAt, NearBy and IsA of the categories are made anew. Statements that people changed, added
    or removed in FILE.ttl stay so.

    example: hereabouts import conceptnet --from conceptnet-assertions-5.7.0.csv.gz --into
    my-ontologies/conceptnet.ttl --dry-run
    """
    from kg.knowledge.conceptnet.importing import import_conceptnet
    from perception.inference.model_zoo import cache_folder

    options: dict[str, Any] = {"language": arguments.language, "dry_run": arguments.dry_run}
    if arguments.ontologies:
        options["ontologies"] = Path(arguments.ontologies)
    if arguments.review:
        options["review"] = Path(arguments.review)
    options["cache"] = Path(arguments.cache or cache_folder() / "conceptnet")
    into = Path(arguments.into) if arguments.into else None
    with _bar(arguments.source) as report:
        imported = import_conceptnet(arguments.source, into, progress=report, **options)
    if arguments.json:
        write_json(_json(imported))
    elif into is None:
        print_table(_FOUND, [_found_row(found) for found in imported.found])
    else:
        print_table(_CHANGES, [_change_row(change) for change in imported.changes])
    _tell(imported, arguments)
    return 0


@contextmanager
def _bar(source: str) -> Iterator[Callable[[int, int], None]]:
    with progress() as bar:
        task = bar.add_task(Path(source).name, total=None, status="")
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _tell(imported: ConceptNetImport, arguments: argparse.Namespace) -> None:
    read = f"{imported.lines} assertions read"
    if imported.requests:
        read += f" in {imported.requests} requests"
    note(
        f"{read}, {imported.used} used; {imported.weak} relations too weak, outvoted or implausible"
    )
    if imported.skipped:
        reasons = ", ".join(f"{n} {reason}" for reason, n in sorted(imported.skipped.items()))
        note(f"skipped {sum(imported.skipped.values())} lines: {reasons}")
    note(_outcome(imported, arguments))
    if arguments.review and not arguments.dry_run:
        note(
            f"wrote {arguments.review}: set keep to no where a relation is wrong, and import again"
        )


def _outcome(imported: ConceptNetImport, arguments: argparse.Namespace) -> str:
    if arguments.into is None:
        return f"{len(imported.found)} relations; nothing written: --into FILE.ttl writes them"
    if arguments.dry_run:
        return f"dry run: {arguments.into} is unchanged"
    if not imported.written:
        return f"{arguments.into} is up to date: nothing written"
    return f"wrote {arguments.into} (data of ConceptNet, CC BY-SA 4.0)"


def _name(iri: str) -> str:
    return shorten(iri).partition(":")[2] or iri


def _found_row(found: ImportedRelation) -> tuple[object, ...]:
    relation = _WORDS[_name(found.kind)]
    numbers = (found.probability, found.weight, found.weight_against)
    return (_name(found.subject), relation, _name(found.target), *numbers, found.surfaces[0])


def _change_row(change: RelationChange) -> tuple[object, ...]:
    relation = _WORDS[_name(change.kind)]
    ends = (_name(change.subject), relation, _name(change.target))
    return (change.what, *ends, change.before, change.after)


def _json(imported: ConceptNetImport) -> dict[str, object]:
    return {
        "found": [
            {
                "relation": _name(found.kind),
                "subject": found.subject,
                "target": found.target,
                "probability": found.probability,
                "weight": found.weight,
                "weightAgainst": found.weight_against,
                "sources": found.sources,
                "licenses": found.licenses,
                "surfaceTexts": found.surfaces,
            }
            for found in imported.found
        ],
        "changes": [
            {
                "change": change.what,
                "relation": _name(change.kind),
                "subject": change.subject,
                "target": change.target,
                "before": change.before,
                "after": change.after,
            }
            for change in imported.changes
        ],
        "written": imported.written,
        "read": imported.lines,
        "used": imported.used,
        "weak": imported.weak,
        "requests": imported.requests,
        "skipped": dict(sorted(imported.skipped.items())),
    }
