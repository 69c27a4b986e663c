"""The history of a map: its log, differences between two moments, compaction, explanations."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import count, declare, keep_seconds, moment_of
from hereabouts.cli.console import counted, note, print_answer, write, write_json

if TYPE_CHECKING:
    from kg.history.point_in_time import Difference
    from kg.history.reports.comparison import Comparison
    from kg.history.reports.explanation import Explanation
    from kg.maps.semantic_map import SemanticMap

_LOG_OPTIONS = """
MAP
[IRI ...] -> thing  object/17, a label such as cup 2, place/1, robot, or an IRI
--last N            only the last N changes
--explain           list every changed fact
--json
"""


def add_log(parser: argparse.ArgumentParser) -> None:
    declare(parser, _LOG_OPTIONS, last=count)


def log(arguments: argparse.Namespace) -> int:
    """List the changes of one thing, each with its time and author.

    Each line is a transaction, the oldest first. Counters, and corrections within the uncertainty
    of what was told before, are left out; --explain lists every changed fact.

    example: hereabouts log kitchen.map object/17
    """
    if not arguments.thing:
        whole_map = f"hereabouts diff {quote(str(arguments.map))} 1h"
        arguments.usage_error(
            f"give the thing, e.g. 'cup 2'; `{whole_map}` tells what changed in the whole map"
        )
    from kg.history.timestamps import iso, spoken
    from kg.serving.opening import open_map

    with open_map(arguments.map, read_only=True) as semantic_map:
        thing = semantic_map.resolve("iri", " ".join(arguments.thing))
        entries = list(semantic_map.history.events(thing))
    whole = arguments.explain or arguments.json
    shown = [entry for entry in entries if whole or entry.told]
    shown = shown if arguments.last is None else shown[len(shown) - arguments.last :]
    rows = [
        (
            e.sequence,
            spoken(e.time),
            e.cause.by or (e.cause_words if arguments.explain else e.cause.kind),
            e.words if arguments.explain else ", ".join(e.told),
        )
        for e in shown
    ]
    records = [
        {
            "sequence": e.sequence,
            "time": iso(e.time),
            **{name: getattr(e.cause, name) for name in ("kind", "by", "note")},
            "changes": list(e.changes),
            "told": list(e.told),
        }
        for e in shown
    ]
    print_answer(("#", "when", "by", "change"), rows, arguments.json, records)
    if arguments.json:
        return 0
    more = "" if arguments.explain else "; --explain lists every changed fact"
    note(f"{len(shown)} of {len(entries)} changes{more}")
    return 0


_COLUMNS = ("change", "thing", "category", "before", "after", "metres")
_ROWS = 6  # changes that are printed without --all
_FACTS = ("change", "subject", "predicate", "before", "after")


_DIFF_OPTIONS = """
MAP
T1 -> before  first moment
[T2] -> after  second moment (default: now)
--moved       only objects that moved
--far M       shortest move [m] (default: 0.3)
--facts       all facts that changed instead
--all         all changes, not only the first 6
--json
"""


def add_diff(parser: argparse.ArgumentParser) -> None:
    declare(parser, _DIFF_OPTIONS, after={"default": "now"}, far={"type": float, "default": 0.3})


def diff(arguments: argparse.Namespace) -> int:
    """List what changed between two moments of the map.

    Objects that appeared, are gone, moved or have another name, rooms that have another name or
    shape, and the area of floor that was seen. A moment is a time in ISO 8601 (UTC if it has no
    zone), words such as yesterday, 2h or now, or a transaction: #42 is the state after the 42nd.
    Where the history begins later than T1, it counts from there. A move counts if it is longer than
    the uncertainty of both positions and than --far.

    example: hereabouts diff kitchen.map '#10' 2026-08-01T12:30:00Z
    """
    from kg.serving.opening import open_map

    with open_map(arguments.map, read_only=True) as semantic_map:
        before = moment_of(arguments.before)
        is_now = arguments.after.strip().casefold() == "now"
        after = f"#{semantic_map.sequence}" if is_now else moment_of(arguments.after)
        history = semantic_map.history
        if arguments.facts:
            return _facts(semantic_map, history.diff(before, after), arguments)
        found = history.compare(before, after, far=arguments.far)
    rows = _rows(found, only_moved=arguments.moved, named=not arguments.json)
    shown = rows if arguments.all or arguments.json else rows[:_ROWS]
    print_answer(_COLUMNS, shown, arguments.json)
    more = "" if len(shown) == len(rows) else f" (the first {_ROWS} are shown; --all lists them)"
    count = counted(len(rows), "change")
    note(f"#{found.before} to #{found.after}: {count}{more}; {found.area_words}")
    return 0


def _rows(found: Comparison, *, only_moved: bool, named: bool) -> list[tuple[object, ...]]:
    """Rows of `_COLUMNS`; things are `named`, or have their IRIs."""
    objects: list[tuple[object, ...]] = [
        (
            one.kind,
            one.name if named else one.iri,
            one.category,
            *one.sides,
            round(one.metres, 2) if one.kind == "moved" and one.metres is not None else None,
        )
        for one in found.changes
        if one.kind == "moved" or not only_moved
    ]
    rooms = [
        (one.kind, one.title if named else one.iri, one.title, one.before, one.after, None)
        for one in found.rooms
    ]
    return objects if only_moved else [*objects, *rooms]


def _facts(semantic_map: SemanticMap, found: Difference, arguments: argparse.Namespace) -> int:
    print_answer(_FACTS, found.rows(semantic_map.base), arguments.json)
    note(
        f"#{found.before} to #{found.after}: {len(found.added)} triples added, "
        f"{len(found.removed)} removed"
    )
    return 0


_COMPACT_OPTIONS = """
MAP
--keep DURATION  length of the history to keep: 30d, 12h, 90m, 2w or 1y (default: all of the past)
--json
"""


def add_compact(parser: argparse.ArgumentParser) -> None:
    declare(parser, _COMPACT_OPTIONS)


def compact(arguments: argparse.Namespace) -> int:
    """Compact a map's history, and with --keep remove its older part.

    The map itself and all later states stay as they are.

    example: hereabouts compact kitchen.map --keep 30d
    """
    from kg.serving.opening import open_map

    keep = keep_seconds(arguments)
    with open_map(arguments.map) as semantic_map:
        done = semantic_map.history.compact(keep)
    if arguments.json:
        write_json(asdict(done))
        return 0
    note(
        f"{done.dropped} transactions dropped; the history begins at #{done.floor}; "
        f"{done.bytes_before / 1e6:.2f} MB before, {done.bytes_after / 1e6:.2f} MB after"
    )
    return 0


_WHY_OPTIONS = """
MAP
[WHAT ...]                   object/17, place/1, a label such as 'cup 2', or an IRI; or subject,
                             predicate and optional object of a fact
--candidates [CATEGORY ...]  the fates of all detections, or of a category's detections, and the
                             things that were seen but are not believed
--format                     how to print it (ttl: SOSA and PROV-O; default: text)
--explain                    every step, with its rule, network, camera pose and transaction
--json -> format             as --format json
"""


def add_why(parser: argparse.ArgumentParser) -> None:
    formats = {"choices": ("text", "json", "ttl"), "default": "text"}
    declare(parser, _WHY_OPTIONS, format=formats)


def why(arguments: argparse.Namespace) -> int:
    """Explain a thing or a fact: the frame, view, source or person behind it.

    --explain goes back to the rule, the network, the box and camera pose, and to the transaction
    that wrote the fact.

    examples: hereabouts why kitchen.map object/17; hereabouts why kitchen.map 'object/17
    here:inPlace place/1'; hereabouts why kitchen.map --candidates keyboard
    """
    if arguments.candidates is not None:
        return _candidates(arguments)
    if not arguments.what:
        arguments.usage_error("give WHAT to explain, e.g. object/17, or --candidates")
    from kg.history.reports.events import reason_sentences, reasons_text
    from kg.history.reports.prov_export import provenance
    from kg.serving.client.record_codec import reason_to_json
    from kg.serving.opening import open_map
    from planner.search.goals.place_names import fact_named

    with open_map(arguments.map, read_only=True) as semantic_map:
        what = fact_named(semantic_map, " ".join(arguments.what))
        reasons = semantic_map.history.explain(what)
        pictures = _pictures(semantic_map, reasons)
    if arguments.format == "ttl":
        write(provenance(*reasons))
    elif arguments.format == "json":
        write_json([reason_to_json(reason) for reason in reasons])
    else:
        told = reason_sentences(reasons)
        write(reasons_text(reasons) if arguments.explain else "\n".join(told))
        for path in pictures:
            write(f"picture: {path}")
    return 0


def _candidates(arguments: argparse.Namespace) -> int:
    """Print the fates of detections."""
    from hereabouts.cli.candidates import explain_detections
    from kg.serving.opening import open_map

    if arguments.format == "ttl":
        arguments.usage_error("--candidates cannot be printed as Turtle; use --json")
    with open_map(arguments.map, read_only=True) as semantic_map:
        category = " ".join([*arguments.candidates, *arguments.what])
        return explain_detections(semantic_map, category, json=arguments.format == "json")


def _pictures(semantic_map: SemanticMap, reasons: Sequence[Explanation]) -> list[Path]:
    """Pictures of the explained objects in the map's folder."""
    from kg.maps.object_pictures import ObjectPictures

    folder = semantic_map.store.path
    if folder is None:
        return []
    pictures = ObjectPictures(folder)
    records = semantic_map.perceived.objects({r.iri for r in reasons if r.iri is not None})
    return [path for record in records if (path := pictures.path_of(record)) is not None]
