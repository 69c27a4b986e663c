"""`hereabouts why MAP --candidates`: fates of detections, and things that are not believed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from hereabouts.cli.console import counted, heading, note, print_table, printable, write, write_json
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from mapping.objects.detections.detection_report import (
    FILE,
    CategoryFates,
    DetectionReport,
    DoubtedThing,
    Fate,
    read_report,
)
from planner.search.goals.search_goals import resolve_target, times

_NAMED: Final = 6  # things in one line
ROWS: Final = 20  # things of all categories in a table
_CATEGORIES: Final = 30  # in a table
_OBJECTS: Final = 8  # of one category

#: the fates in order, each as the predicate of "a detection"
_WORDS: Final[Mapping[Fate, str]] = {
    Fate.OBJECT: "joined an object of the map",
    Fate.CANDIDATE: "made a candidate, which is still too improbable for the map",
    Fate.FORGOTTEN: "made a candidate that was dropped: too improbable, or not seen again",
    Fate.LEFT: "joined an object that is no longer in the map",
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
        _print(report, len(report.things) if category else ROWS)
    return 0


def detections_in_vain(semantic_map: SemanticMap, label: str, address: str) -> str:
    """A sentence on detections of a category that has no object in the map; "" without any."""
    try:
        report = None if semantic_map.store.path is None else read_report(semantic_map.store.path)
    except GraphError as error:
        note(str(error))
        return ""
    fates = None if report is None else report.categories.get(label)
    if fates is None or not fates.detections:
        return ""
    weak = fates.fates.get(Fate.WEAK, 0)
    some = "each time" if weak == fates.detections else f"{times(weak)} of these"
    reason = f", {some} with too low a score" if weak else ""
    return (
        f"The detector reported {label} {times(fates.detections)}{reason}: not enough for an "
        f"object of the map (hereabouts why {address} --candidates {label})"
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
            "`hereabouts map --again` writes the file"
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
    return DetectionReport(
        frames=report.frames,
        categories={name: report.categories.get(name, CategoryFates({}))},
        things=things,
        doubted=sum(not one.forgotten for one in things),
        least_score=report.least_score,
        nearest=report.nearest,
        farthest=report.farthest,
    )


def _print(report: DetectionReport, max_rows: int) -> None:
    """Print the counts of detections by fate, the objects they joined, and doubted things."""
    total = sum(of.detections for of in report.categories.values())
    only = f"{printable(next(iter(report.categories)))}: " if len(report.categories) == 1 else ""
    write(f"{only}{counted(total, 'detection')} in {report.frames} frames")
    if not total:
        note("not even one had a score too low to count; see hereabouts models list")
    elif report.categories:
        print_table(*fate_table(report))
    for line in legend(report, shown_fates(report)):
        note(line)
    if only:
        (of,) = report.categories.values()
        for iri, count in list(of.objects.items())[:_OBJECTS]:
            note(f"{count} joined {printable(short(iri))}")
    _print_things(report.things, max_rows)


def _print_things(things: tuple[DoubtedThing, ...], max_rows: int) -> None:
    if not things:
        return
    heading("Seen but not believed")
    print_table(*things_table(things, max_rows))
    if len(things) > max_rows:
        note(f"and {len(things) - max_rows} more: --json, or name a category")


def listed_things(things: Sequence[DoubtedThing]) -> str:
    """The most probable thing of each category in one line, the most probable first."""
    best = {one.category: one for one in reversed(things)}
    ranked = [best[category] for category in dict.fromkeys(one.category for one in things)]
    named = [
        f"{one.category} {one.existence:.2f}" + " (from one side only)" * one.one_side
        for one in ranked
    ]
    kinds = len(named) - _NAMED
    more = f" and {kinds} more kind{'s' * (kinds > 1)}" if kinds > 0 else ""
    first = "the best of each kind: " if len(named) < len(things) else ""
    return first + ", ".join(named[:_NAMED]) + more


def legend(report: DetectionReport, fates: Iterable[Fate]) -> list[str]:
    """The meaning of each fate, one line each."""
    return [f"{fate}: the detection {_words(report, fate)}" for fate in fates]


def fate_table(report: DetectionReport) -> tuple[tuple[str, ...], list[Sequence[object]]]:
    """Columns and rows of the counts by category, the most detected first."""
    fates = shown_fates(report)
    rows: list[Sequence[object]] = [
        (name, of.detections, *(of.fates.get(fate) for fate in fates), of.merged or None)
        for name, of in list(report.categories.items())[:_CATEGORIES]
    ]
    return ("category", "detections", *(fate.value for fate in fates), "merged"), rows


def shown_fates(report: DetectionReport) -> list[Fate]:
    """The fates that any detection has."""
    return [fate for fate in _WORDS if any(of.fates.get(fate) for of in report.categories.values())]


def short(iri: str) -> str:
    """``object/12``."""
    return "/".join(iri.rsplit("/", 2)[-2:])


def things_table(
    things: Sequence[DoubtedThing], max_rows: int = ROWS
) -> tuple[tuple[str, ...], list[Sequence[object]]]:
    """Columns and rows of things that are not believed, with their best view."""
    columns = ("category", "thing", "existence", "seen", "from", "score", "best frame", "box [px]")
    rows: list[Sequence[object]] = [
        (
            one.category,
            short(one.iri) if one.iri else "forgotten" if one.forgotten else "candidate",
            one.existence,
            one.seen,
            "one side" if one.one_side else "",
            one.score if one.frame else None,
            "/".join(filter(None, (one.recording, one.frame))),
            "" if one.box is None else " ".join(f"{side:.0f}" for side in one.box),
        )
        for one in things[:max_rows]
    ]
    return columns, rows


def _words(report: DetectionReport, fate: Fate) -> str:
    return _WORDS[fate].format(
        least=report.least_score, nearest=report.nearest, farthest=report.farthest
    )
