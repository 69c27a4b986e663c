"""Changes of a map by people: assertions and their retraction, updates, restored states."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import counted, note, notes_of, write_json
from kg.model.vocabulary import AssertedProperty

if TYPE_CHECKING:
    from kg.maps.update.restoration import Restored

#: what `assert` and `retract` are about
_THING = """
MAP
THING                 object/17, place/1, a label such as 'cup 2', or an IRI
PROPERTY -> property  property of the thing
"""
_PROPERTY: Final = {"choices": get_args(AssertedProperty), "metavar": None}
_ASSERTION_OPTIONS = f"""
{_THING}
VALUE ...             category: name or IRI; position: X Y Z in metres; extent: DX DY DZ in metres
                      and the box's YAW in radians; existence: present or absent; label, note: text;
                      on, inside: another object (object/3) or nothing; area: POLYGON ((x y, ...))
                      in metres
--by
--json
"""


def add_assertion(parser: argparse.ArgumentParser) -> None:
    declare(parser, _ASSERTION_OPTIONS, property=_PROPERTY)


def assertion(arguments: argparse.Namespace) -> int:
    """Assert a property of an object or place; it outranks perception until retracted.

    Objects have a category, position, extent, existence, label, and what they are on or inside;
    places have a category, a label and a note. `hereabouts ask MAP conflicts` lists the assertions
    that perception contradicts.

    example: hereabouts assert kitchen.map object/17 category bowl --by ann
    """
    from kg.maps.facts.assertions import kept_property
    from kg.serving.opening import open_map
    from kg.store.folder import is_url

    if arguments.by is None and not is_url(arguments.map):
        arguments.usage_error("an assertion needs an author: --by NAME")
    value = given = " ".join(arguments.value)
    by = arguments.by or ""
    with open_map(arguments.map) as semantic_map:
        thing = semantic_map.resolve("iri", arguments.thing)
        change = semantic_map.assertions.add(thing, arguments.property, value, by=by)
        stated = kept_property(arguments.property, thing)
        (made,) = (a for a in semantic_map.assertions.all(thing) if a.property == stated)
        sequence = semantic_map.sequence
    if arguments.json:
        write_json(
            {
                "thing": made.subject,
                "property": made.property,
                "value": made.value,
                "by": made.by,
                "perceived": made.perceived,
                "contradicted": made.since is not None,
                "changed": change is not None,
                "sequence": sequence,
                **notes_of(change, shown=False),
            }
        )
        return 0
    done = f"transaction {change.sequence}" if change else "nothing changed"
    against = "; perception contradicts it" if made.since is not None else ""
    fact = f"{arguments.thing}: {arguments.property} is {given}"
    note(f"{fact} (asserted by {made.by}{against}); {done}")
    notes_of(change, shown=True)
    return 0


def add_retract(parser: argparse.ArgumentParser) -> None:
    declare(parser, f"{_THING}\n--by\n--json", property=_PROPERTY)


def retract(arguments: argparse.Namespace) -> int:
    """Retract an assertion; the value of perception is restored.

    Perception has kept its value up to date. `hereabouts ask MAP assertions` lists all assertions.
    One that somebody else has made in place of one's own stays.

    example: hereabouts retract kitchen.map object/17 category --by ann
    """
    from kg.serving.opening import open_map

    with open_map(arguments.map) as semantic_map:
        change = semantic_map.assertions.retract(
            arguments.thing, arguments.property, by=arguments.by
        )
        sequence = semantic_map.sequence
    if arguments.json:
        write_json(
            {
                "thing": arguments.thing,
                "property": arguments.property,
                "by": change.cause.by if change else arguments.by,
                "changed": change is not None,
                "sequence": sequence,
                **notes_of(change, shown=False),
            }
        )
        return 0
    done = f"transaction {change.sequence}" if change else "nothing changed"
    now = "is removed" if arguments.property == "note" else "has the value of perception"
    note(f"{arguments.thing}: {arguments.property} {now}; {done}")
    notes_of(change, shown=True)
    return 0


_UPDATE_OPTIONS = """
MAP
[FILE.ru] -> file     file with the update
-e, --execute SPARQL  the update as text
--by
--yes                 confirm that a large share of the map is deleted
--json
"""


def add_update(parser: argparse.ArgumentParser) -> None:
    declare(parser, _UPDATE_OPTIONS)


def update(arguments: argparse.Namespace) -> int:
    """Change the map by SPARQL Update, validated and in one transaction.

    An update that violates the SHACL shapes is refused as a whole. An update that deletes more than
    10 objects and places, and more than a tenth of all, needs --yes. `hereabouts restore` undoes an
    update. A triple without GRAPH belongs to graph:map.

    example: hereabouts update kitchen.map --by ann -e 'INSERT DATA { <http://example.org/mine> a
    here:Cup ; here:x 1.2 ; here:y 0.4 }'
    """
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


_RESTORE_OPTIONS = """
MAP
--to WHEN        #254 (the state after that transaction), or a time: 2026-08-01T12:30:00Z, yesterday
--only WHAT ...  objects, places, assertions, ontology, or one thing by name or IRI (repeatable)
--by
--yes            confirm that a large share of the map is deleted
--dry-run        only count what would change
--json
"""


def add_restore(parser: argparse.ArgumentParser) -> None:
    declare(parser, _RESTORE_OPTIONS, to={"required": True})


def restore(arguments: argparse.Namespace) -> int:
    """Restore a past state of the map in a new transaction.

    The history keeps both states, so a restoration can be undone too. The ontology is restored as
    well, the number of the next object is not; --only restores a part. On a running server the
    author is the holder of HEREABOUTS_TOKEN.

    example: hereabouts restore kitchen.map --to '#254' --only objects --by ann
    """
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
