"""Import common sense or statistics of rooms."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import MAP_HELP, add_command, declare, title_for
from hereabouts.cli.console import note, print_table, progress, write_json
from kg.model.vocabulary import shorten

if TYPE_CHECKING:
    from kg.knowledge.conceptnet.importing import ConceptNetImport
    from kg.knowledge.conceptnet.relate import ImportedRelation
    from kg.knowledge.conceptnet.turtle import RelationChange


def add(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(dest="kind", metavar="WHAT", required=True)
    add_conceptnet(kinds)
    add_rooms(kinds)


_ROOMS_OPTIONS = f"""
CSV -> table         the table; s3dis: shipped statistics of offices
--into FILE.ttl|MAP  an ontology file to write, or {MAP_HELP}
--source NAME        name of the statistics (default: the file name)
--license IRI        licence of the counts
--json
"""


def add_rooms(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = add_command(kinds, "rooms", rooms.__doc__ or "", run=rooms)
    declare(parser, _ROOMS_OPTIONS, into={"required": True}, license={"default": ""})


def rooms(arguments: argparse.Namespace) -> int:
    """Read statistics of real rooms: how many rooms of a kind contain an object (CSV).

    The table has the columns room, n_rooms, object, rooms_with_object. Its counts then enter every
    probability of the map, or of maps made with the file.

    example: hereabouts import rooms room_counts.csv --into homes.ttl
    """
    from kg.knowledge.ontology.catalogue import Catalogue
    from kg.knowledge.ontology.loading import load_ontologies
    from kg.knowledge.placement.statistics import SHIPPED, read_rooms, write_rooms
    from kg.maps.room_statistics import import_rooms
    from kg.serving.opening import open_or_create_map

    path = Path(arguments.table)
    path, name, terms = SHIPPED.get(arguments.table, (path, path.stem, ""))
    source = " ".join((arguments.source or name).split()) or "rooms"
    license_iri = checked_iri(arguments.license or terms)
    shipped = Catalogue.from_quads(load_ontologies().quads)
    table = read_rooms(path, shipped, source, license_iri)
    if is_ontology_file(arguments.into):
        write_rooms(table, Path(arguments.into))
        changed = None
    else:
        title = title_for(arguments.into)
        with open_or_create_map(arguments.into, title=title) as semantic_map:
            table = read_rooms(path, semantic_map.catalogue, source, license_iri)
            changed = import_rooms(semantic_map, table)
    result = {
        "source": source,
        "statistics": len(table.statistics),
        "new_kinds_of_room": [kind.label for kind in table.new_types],
        "rooms_left_out": list(table.mixed),
        "objects_left_out": list(table.unknown),
        "triples_changed": changed,
    }
    if arguments.json:
        write_json(result)
    else:
        print_table(("", ""), [(k.replace("_", " "), _cell(value)) for k, value in result.items()])
        note(f"imported into {arguments.into}")
    return 0


def is_ontology_file(into: str) -> bool:
    """Whether `into` is a Turtle file, not a map; raises InvalidFactError for other syntaxes."""
    from kg.model.errors import InvalidFactError
    from kg.rdf.parsing import ENDINGS

    ending = Path(into).suffix.lower()
    if ending in ENDINGS and ending != ".ttl":
        raise InvalidFactError(f"--into {into}: an ontology file is written as Turtle; name a .ttl")
    return ending == ".ttl"


def checked_iri(text: str) -> str:
    """`text` if it is an IRI or empty; raises InvalidFactError otherwise."""
    from kg.knowledge.placement.statistics import is_iri
    from kg.model.errors import InvalidFactError

    if text and not is_iri(text):
        raise InvalidFactError(
            f"--license must be an IRI such as https://www.apache.org/licenses/LICENSE-2.0, "
            f"got {text!r}"
        )
    return text


def _cell(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(value) or "none"
    return "-" if value is None else str(value)


_FOUND = ("what", "", "where", "p", "weight", "against", "wording")
_CHANGES = ("change", "what", "", "where", "p before", "p after")
_WORDS = {"locatedAt": "located at", "nearBy": "near", "subClassOf": "is a"}


_CONCEPTNET_OPTIONS = """
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


def add_conceptnet(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = add_command(kinds, "conceptnet", conceptnet.__doc__ or "", run=conceptnet)
    declare(parser, _CONCEPTNET_OPTIONS, source={"required": True}, language={"default": "en"})


def conceptnet(arguments: argparse.Namespace) -> int:
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
