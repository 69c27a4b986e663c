"""`hereabouts why MAP --candidates`: fates of detections, and things that are not believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from hereabouts.cli.console import counted, heading, note, print_table, printable, write, write_json
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from mapping.objects.detections.detection_report import (
    FILE,
    DetectionReport,
    DoubtedThing,
    Fate,
    read_report,
)
from planner.search.goals.search_goals import resolve_target, times

_NAMED: Final = 6  # things in one line
_ROWS: Final = 20  # things of all categories in a table
_CATEGORIES: Final = 30  # in a table
_COLUMNS: Final = ("category", "thing", "existence", "seen", "score", "best frame", "box [px]")

#: the fates, each as the predicate of "a detection"
_WORDS: Final[Mapping[Fate, str]] = {
    Fate.OBJECT: "joined an object of the map, which may have left it since",
    Fate.CANDIDATE: "made a candidate, which is still too improbable for the map",
    Fate.FORGOTTEN: "made a candidate that was dropped: too improbable, or not seen again",
    Fate.WEAK: "had a score below {least:g}, which is too low",
    Fate.UNKNOWN: "had a label without a category",
    Fate.IGNORED: "had a label that the labels map ignores",
    Fate.NO_DEPTH: "had no usable depth",
    Fate.NEAR: "was too near (below {nearest:g} m)",
    Fate.FAR: "was too far away (beyond {farthest:g} m)",
    Fate.CUT: "was cut off by the image border, beside a thing of that category",
    Fate.DOUBLE: "doubled another box of the same frame",
}


def explain_detections(semantic_map: SemanticMap, category: str, *, json: bool) -> int:
    """Print the fates of the detections of `category`, or of all if it is "".

    Raises GraphError where the map keeps no report, UnknownCategoryError for a word that neither
    the map nor a network knows.
    """
    report = _report(semantic_map)
    if category:
        report = _of_category(report, _name(semantic_map, report, category))
    if json:
        write_json(report.to_json())
    else:
        _print(report, len(report.things) if category else _ROWS)
    return 0


def detections_in_vain(semantic_map: SemanticMap, label: str) -> str:
    """A sentence on detections of a category that has no object in the map; "" without any."""
    try:
        report = None if semantic_map.store.path is None else read_report(semantic_map.store.path)
    except GraphError as error:
        note(str(error))
        return ""
    fates = None if report is None else report.categories.get(label)
    if not fates:
        return ""
    total, weak = sum(fates.values()), fates.get(Fate.WEAK, 0)
    some = "each time" if weak == total else f"{times(weak)} of these"
    reason = f", {some} with too low a score" if weak else ""
    return (
        f"The detector reported {label} {times(total)}{reason}: not enough for an "
        f"object of the map (hereabouts why MAP --candidates {label})"
    )


def _report(semantic_map: SemanticMap) -> DetectionReport:
    folder = semantic_map.store.path
    if folder is None:
        raise GraphError(
            "the fates of detections are stored in the map's folder, and this map has no folder "
            "here; ask on the machine that mapped it"
        )
    report = read_report(folder)
    if report is None:
        raise GraphError(
            f"{folder} has no {FILE}: no detector has mapped into it, or an earlier version did; "
            "mapping a recording again, with --again, writes the file"
        )
    return report


def _name(semantic_map: SemanticMap, report: DetectionReport, category: str) -> str:
    """The category's label, or a label that a network gave."""
    labels = {name.casefold(): name for name in report.categories}
    known = semantic_map.catalogue.get(category, "object")
    if known is None and category.casefold() in labels:
        return labels[category.casefold()]
    return resolve_target(semantic_map.catalogue, category).label


def _of_category(report: DetectionReport, name: str) -> DetectionReport:
    things = tuple(one for one in report.things if one.category == name)
    categories = {name: report.categories.get(name, {})}
    return replace(report, categories=categories, things=things, doubted=len(things))


def _print(report: DetectionReport, max_rows: int) -> None:
    """Print the counts of detections by fate, and doubted things."""
    total = sum(sum(fates.values()) for fates in report.categories.values())
    only = f"{printable(next(iter(report.categories)))}: " if len(report.categories) == 1 else ""
    write(f"{only}{counted(total, 'detection')} in {report.frames} frames")
    if not total:
        note("not even one had a score too low to count; see hereabouts models list")
    else:
        shown = [f for f in Fate if any(of.get(f) for of in report.categories.values())]
        print_table(
            ("category", "detections", *shown),
            [
                (name, sum(of.values()), *(of.get(fate) for fate in shown))
                for name, of in list(report.categories.items())[:_CATEGORIES]
            ],
        )
        for fate in shown:
            words = _WORDS[fate].format(
                least=report.least_score, nearest=report.nearest, farthest=report.farthest
            )
            note(f"{fate}: the detection {words}")
    if report.things:
        heading("Seen but not believed")
        print_table(_COLUMNS, [_row(one) for one in report.things[:max_rows]])
    if len(report.things) > max_rows:
        note(f"and {len(report.things) - max_rows} more: --json, or name a category")


def _row(one: DoubtedThing) -> tuple[object, ...]:
    """A row of _COLUMNS: a thing that is not believed, with its best view."""
    return (
        one.category,
        "/".join(one.iri.rsplit("/", 2)[-2:]) or "candidate",
        one.existence,
        one.seen,
        one.score if one.frame else None,
        "/".join(filter(None, (one.recording, one.frame))),
        "" if one.box is None else " ".join(f"{side:.0f}" for side in one.box),
    )


def listed_things(things: Sequence[DoubtedThing]) -> str:
    """The most probable thing of each category in one line, the most probable first."""
    best = {one.category: one for one in reversed(things)}
    ranked = sorted(best.values(), key=lambda one: -one.existence)
    named = [f"{one.category} {one.existence:.2f}" for one in ranked]
    kinds = len(named) - _NAMED
    more = f" and {kinds} more kind{'s' * (kinds > 1)}" if kinds > 0 else ""
    first = "the best of each kind: " if len(named) < len(things) else ""
    return first + ", ".join(named[:_NAMED]) + more
