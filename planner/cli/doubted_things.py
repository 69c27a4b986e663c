"""What was seen but is not believed, and what became of detections, in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from mapping.detection_report import BELIEVED, Fate

if TYPE_CHECKING:
    from mapping.detection_report import CategoryFates, DetectionReport, DoubtedThing

_NAMED: Final = 6  # things in one line
ROWS: Final = 20  # things of all categories in a table
_CATEGORIES: Final = 30  # in a table

#: the fates in order, each as a sentence's end
_WORDS: Final[Mapping[Fate, str]] = {
    Fate.OBJECT: "joined objects of the map",
    Fate.CANDIDATE: "belong to candidates, which are too improbable for the map",
    Fate.FORGOTTEN: "belonged to candidates that were dropped, as they were not seen again",
    Fate.LEFT: "belonged to objects that are no longer in the map",
    Fate.WEAK: "had a score below {least:g}, which is too weak",
    Fate.UNKNOWN: "had a label that no category has",
    Fate.IGNORED: "had a label that the labels map says to ignore",
    Fate.NO_DEPTH: "had no usable depth",
    Fate.NEAR: "were too near (below {nearest:g} m)",
    Fate.FAR: "were too far (beyond {farthest:g} m)",
    Fate.CUT: "were cut by the image's border, beside a thing of their category",
    Fate.DOUBLE: "showed a thing that another box of the same frame shows",
}


def listed_things(things: Sequence[DoubtedThing]) -> str:
    """The most probable thing of each category in one line, the most probable first."""
    best = {one.category: one for one in reversed(things)}
    ranked = [best[category] for category in dict.fromkeys(one.category for one in things)]
    named = [
        f"{one.category} {shown(one.existence)}" + " (from one side only)" * one.one_side
        for one in ranked
    ]
    kinds = len(named) - _NAMED
    more = f" and {kinds} more kind{'s' * (kinds > 1)}" if kinds > 0 else ""
    first = "the best of each kind: " if len(named) < len(things) else ""
    return first + ", ".join(named[:_NAMED]) + more


def shown(existence: float) -> str:
    """Two digits of an existence below 0.5, which never read as 0.5."""
    return f"{min(existence, 0.49):.2f}"


def legend(report: DetectionReport, fates: Iterable[Fate]) -> list[str]:
    """What each fate means, a line each."""
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
    report: DetectionReport, name: str, of: CategoryFates, existences: Mapping[str, float]
) -> list[str]:
    """What became of the detections of one category; `existences` are those of objects now."""
    count = f"{of.detections} detection{'s' * (of.detections != 1)}"
    lines = [f"{name}: {count} in {report.frames} frames"]
    for fate in _WORDS:
        if of.fates.get(fate):
            lines.append(f"  {of.fates[fate]} {_words(report, fate)}")
        if fate is Fate.OBJECT and of.objects:
            lines.append(f"    {_joined(of, existences)}")
    if of.merged:
        found = "thing was" if of.merged == 1 else "things were"
        lines.append(
            f"  {of.merged} {found} merged into another one that turned out to be the same"
        )
    return lines


def _joined(of: CategoryFates, existences: Mapping[str, float]) -> str:
    """The objects that detections joined, with how many and their existence."""
    told = []
    for iri, count in of.objects.items():
        existence = existences.get(iri)
        now = "no longer there" if existence is None else f"existence {existence:.2f}"
        told.append(f"{short(iri)} {count} times ({now})" if count > 1 else f"{short(iri)} ({now})")
    return ", ".join(told)


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
            shown(one.existence) if one.existence < BELIEVED else f"{one.existence:.2f}",
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
