"""`hereabouts why MAP --candidates`: fates of detections, and things that are not believed."""

from __future__ import annotations

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, UnknownCategoryError
from mapping.detection_report import (
    FILE,
    CategoryFates,
    DetectionReport,
    DoubtedThing,
    Fate,
    read_report,
)
from planner.cli.console import counted, heading, note, print_table, write, write_json
from planner.cli.doubted_things import (
    ROWS,
    advice,
    category_lines,
    fate_table,
    legend,
    short,
    shown_fates,
    things_table,
)
from planner.cli.text_table import printable


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
    elif category:
        _print_category(semantic_map, report)
    else:
        _print_all(report)
    return 0


def detections_in_vain(semantic_map: SemanticMap, label: str, address: str) -> str:
    """A sentence on detections of a category without an object in the map; "" without any."""
    try:
        report = None if semantic_map.store.path is None else read_report(semantic_map.store.path)
    except GraphError:
        return ""
    of = None if report is None else report.categories.get(label)
    if of is None or not of.detections:
        return ""
    weak = of.fates.get(Fate.WEAK, 0)
    told = f"; {weak} of them {'was' if weak == 1 else 'were'} too weak" if weak else ""
    if weak == of.detections:
        told = "; all of them were too weak" if weak > 1 else "; it was too weak"
    return (
        f"{counted(of.detections, 'detection')} made no {label} of the map{told} "
        f"(hereabouts why {address} --candidates {label})"
    )


def _report(semantic_map: SemanticMap) -> DetectionReport:
    folder = semantic_map.store.path
    if folder is None:
        raise GraphError(
            "what became of detections is kept in a map's folder, and this map has none here; "
            "ask where it was mapped"
        )
    report = read_report(folder)
    if report is None:
        raise GraphError(
            f"{folder} has no {FILE}: nothing was mapped into it by a detector, or by an earlier "
            "version; `hereabouts map --again` writes it"
        )
    return report


def _name(semantic_map: SemanticMap, report: DetectionReport, category: str) -> str:
    """The category's label, or a network's label that was met."""
    try:
        return semantic_map.catalogue.find(category, "object").label
    except UnknownCategoryError:
        met = {name.casefold(): name for name in report.categories}
        if category.casefold() in met:
            return met[category.casefold()]
        raise


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


def _print_category(semantic_map: SemanticMap, report: DetectionReport) -> None:
    ((name, of),) = report.categories.items()
    if not of.detections:
        write(
            f"{printable(name)}: the detector never saw one in {report.frames} frames, not even "
            "too weakly to count; another detector may (hereabouts models list)"
        )
    else:
        write(printable("\n".join(category_lines(report, name, of, _objects(semantic_map)))))
    _print_things(report.things, len(report.things))
    if advice(of):
        note(advice(of))


def _objects(semantic_map: SemanticMap) -> dict[str, str]:
    """The map's objects in words, by IRI."""
    name = semantic_map.catalogue.label
    return {
        one.iri: f"{name(one.category)} {one.iri.rpartition('/')[2]} "
        f"({short(one.iri)}, existence {one.existence:.2f})"
        for one in semantic_map.objects()
    }


def _print_all(report: DetectionReport) -> None:
    total = sum(of.detections for of in report.categories.values())
    write(f"{total} detections in {report.frames} frames")
    if report.categories:
        print_table(*fate_table(report))
    for line in legend(report, shown_fates(report)):
        note(line)
    _print_things(report.things, ROWS)


def _print_things(things: tuple[DoubtedThing, ...], most: int) -> None:
    if not things:
        return
    heading("Seen but not believed")
    print_table(*things_table(things, most))
    if len(things) > most:
        note(f"and {len(things) - most} more: --json, or name a category")
