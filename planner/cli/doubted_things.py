"""Things that were detected but are not believed, and fates of detections, in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from mapping.detection_report import Fate
from planner.cli.console import counted

if TYPE_CHECKING:
    from mapping.detection_report import CategoryFates, DetectionReport, DoubtedThing

_NAMED: Final = 6  # things in one line
ROWS: Final = 20  # things of all categories in a table
_CATEGORIES: Final = 30  # in a table
_OBJECTS: Final = 8  # of one category

#: the fates in order, each as a sentence's end
_WORDS: Final[Mapping[Fate, str]] = {
    Fate.OBJECT: "joined objects of the map",
    Fate.CANDIDATE: "made candidates, which are still too improbable for the map",
    Fate.FORGOTTEN: "made candidates that were dropped, too improbable or not seen again",
    Fate.LEFT: "joined objects that are no longer in the map",
    Fate.WEAK: "had a score below {least:g}, which is too weak",
    Fate.UNKNOWN: "had a label that no category has",
    Fate.IGNORED: "had a label that the labels map says to ignore",
    Fate.NO_DEPTH: "had no usable depth",
    Fate.NEAR: "lay too near (below {nearest:g} m)",
    Fate.FAR: "lay too far away (beyond {farthest:g} m)",
    Fate.CUT: "lay at the image's border, beside a thing of that category",
    Fate.DOUBLE: "showed a thing that another box of the same frame shows",
}

#: advice for when most detections have this fate
_ADVICE: Final[Mapping[Fate, str]] = {
    Fate.WEAK: "a lower --threshold counts weak detections, and more mistakes with them; another "
    "--detector may be surer (hereabouts models list)",
    Fate.UNKNOWN: "--labels-map says what a label means",
    Fate.NO_DEPTH: "--pictures DIR saves frames with their boxes; depth that does not fit the "
    "colour images, or its scale, may be the reason",
    Fate.NEAR: "depth in other units than the recording says would look like this",
    Fate.FAR: "depth in other units than the recording says would look like this",
    Fate.FORGOTTEN: "poses that jump spread one thing over several places (hereabouts info)",
}


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
    return [f"{fate}: they {_words(report, fate)}" for fate in fates]


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


def category_lines(
    report: DetectionReport, name: str, of: CategoryFates, objects: Mapping[str, str]
) -> list[str]:
    """Fates of the detections of one category; `objects` are those of the map, in words."""
    lines = [f"{name}: {counted(of.detections, 'detection')} in {report.frames} frames"]
    for fate in _WORDS:
        if of.fates.get(fate):
            told = ":" * (fate is Fate.OBJECT and bool(of.objects))
            lines.append(f"  {of.fates[fate]} {_words(report, fate)}{told}")
        if fate is Fate.OBJECT:
            lines += [
                f"    {count} joined {objects.get(iri, f'{short(iri)}, which is gone')}"
                for iri, count in list(of.objects.items())[:_OBJECTS]
            ]
    if of.merged:
        lines.append(f"  {counted(of.merged, 'thing')} turned out to be the same as another one")
    return lines


def advice(of: CategoryFates) -> str:
    """Advice if most detections were lost for one reason, else ""."""
    lost = {fate: count for fate, count in of.fates.items() if fate in _ADVICE}
    most = max(lost, key=lambda fate: lost[fate], default=None)
    return _ADVICE[most] if most is not None and 2 * lost[most] > of.detections else ""


def short(iri: str) -> str:
    """``object/12``."""
    return "/".join(iri.rsplit("/", 2)[-2:])


def things_table(
    things: Sequence[DoubtedThing], most: int = ROWS
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
        for one in things[:most]
    ]
    return columns, rows


def _words(report: DetectionReport, fate: Fate) -> str:
    return _WORDS[fate].format(
        least=report.least_score, nearest=report.nearest, farthest=report.farthest
    )
