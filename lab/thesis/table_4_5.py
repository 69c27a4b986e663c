"""The thesis' search experiment: its building as a real map, its 18 searches by real queries.

The building is Fig. 4.7, the searches Table 4.5 (section 4.4). Data and the corrections of rows
that contradict themselves lie in `lab/thesis/`. ``python -m lab.thesis`` prints
`lab/research/table_4_5.md`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean

import numpy as np
from numpy.typing import ArrayLike

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import in_memory_map
from lab.thesis.rule_execution import RuleOutcome, follow, in_place
from lab.thesis.scenarios import (
    DATA,
    Erratum,
    Published,
    Scenario,
    corrections,
    rows_of,
    scenarios,
)
from planner.search.goals.search_goals import Goal, derive_goals
from planner.search.plans.thesis_rules import Plan, Travel, nearest_first

_ABOUT = """\
Printed by `python -m lab.thesis` from `lab/thesis/`; a test keeps it equal. The
thesis' building (its Fig. 4.7) is built as a semantic map, every row's goals come from
`queries/goals-*.rq` over the shipped ontology, and both rules are the planner's. n counts places
explored until the object is found, t is seconds; r is the ontology's rule (nearest goal first), b
brute force (nearest place first, every place explored). Each cell: computed / published, a star
where n differs."""


@dataclass(frozen=True, slots=True, eq=False)
class TableRow:
    """One search of Table 4.5, computed."""

    scenario: Scenario
    ontology: RuleOutcome  # nearest-first over the goals that the graph's queries gave
    brute: RuleOutcome

    @property
    def ratio(self) -> float:
        """The time of brute force as a multiple of this one."""
        return self.brute.seconds / self.ontology.seconds


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of the rows."""

    rows: int
    equal_n_r: int  # rows with as many rooms explored as published
    equal_n_b: int
    mean_t_r: float  # [s]
    mean_t_b: float  # [s]
    mean_ratio: float  # mean of the rows' ratios: the thesis' headline
    ratio_of_means: float


@dataclass(frozen=True, slots=True)
class RowAgreement:
    """Rows with as many rooms explored as published, by one reading of the printed rows."""

    reading: str
    n_r: int
    n_b: int


@dataclass(frozen=True, slots=True, eq=False)
class ThesisTable:
    """Table 4.5, computed beside the published numbers."""

    rows: tuple[TableRow, ...]
    corrections: tuple[Erratum, ...]
    uncorrected: tuple[RowAgreement, ...]  # what the rows give as they are printed

    @property
    def summary(self) -> Summary:
        """Summary of the rows."""
        return summarise(self.rows)

    def to_json(self) -> dict[str, object]:
        """Rows, summary and corrections as plain values; times to 0.01 s."""
        summary = {key: round(value, 3) for key, value in asdict(self.summary).items()}
        return {
            "rows": [_row_json(row) for row in self.rows],
            "summary": summary,
            "corrections": [asdict(fix) for fix in self.corrections],
            "uncorrected": [asdict(one) for one in self.uncorrected],
        }

    def to_markdown(self) -> str:
        """The whole of `lab/research/table_4_5.md`."""
        return markdown(self.rows, self.corrections, self.uncorrected)


def run_table_4_5(data: Path = DATA, *, travel: Travel | None = None) -> ThesisTable:
    """Compute Table 4.5 as `table_4_5` does, with the corrections that were made."""
    with reference_world(data) as world:
        printed = tuple(_agreement(world, scenarios(data), travel))
    return ThesisTable(table_4_5(data, travel=travel), corrections(data), printed)


def _agreement(
    world: SemanticMap, rows: Sequence[Scenario], travel: Travel | None
) -> Iterator[RowAgreement]:
    """Agreement without corrections: objects where their poses lie, or in their printed places."""
    areas = {int(p.iri.rsplit("/", 1)[1]): p.area for p in world.places()}
    readings = {
        "poses as printed": [
            next(k for k, area in areas.items() if area.contains(*one.printed_object.tolist()))
            for one in rows
        ],
        "places as printed": [one.printed_object_place for one in rows],
    }
    for reading, hidden in readings.items():
        printed = (
            replace(one, object_place=place, start=one.printed_start)
            for one, place in zip(rows, hidden, strict=True)
        )
        summary = summarise([_search(world, one, travel) for one in printed])
        yield RowAgreement(reading, summary.equal_n_r, summary.equal_n_b)


def reference_world(data: Path = DATA) -> SemanticMap:
    """Fig. 4.7 as a map in memory: 10 explored places, each certain of its category, no objects.

    Place ids are the thesis' own, 0 to 9. Raises LayoutError without the data.
    """
    world = in_memory_map(title="the thesis' building")
    places = tuple(
        PlaceRecord(
            iri=world.place_iri(int(row["id"])),
            label=f"place {row['id']}",
            xmin=float(row["xmin"]),
            xmax=float(row["xmax"]),
            ymin=float(row["ymin"]),
            ymax=float(row["ymax"]),
            views=1,
            beliefs={world.catalogue.find(row["category"], "place").iri: 1.0},
        )
        for row in rows_of("search_world_places.csv", data)
    )
    world.apply(MapUpdate(places=places))
    return world


def table_4_5(data: Path = DATA, *, travel: Travel | None = None) -> tuple[TableRow, ...]:
    """Every search of Table 4.5 with the goals that the graph's queries give.

    The object is in the one place the scenario says (model `single`) and not in the map, so only
    places are goals. Raises LayoutError without the data.
    """
    with reference_world(data) as world:
        return tuple(_search(world, scenario, travel) for scenario in scenarios(data))


def _search(world: SemanticMap, scenario: Scenario, travel: Travel | None) -> TableRow:
    hidden = in_place(world.place_iri(scenario.object_place))
    goals = derive_goals(world, scenario.target)
    planned = nearest_first(scenario.start, goals, target=scenario.target, travel=travel)
    swept = brute_force(scenario.start, world.places(), target=scenario.target, travel=travel)
    return TableRow(scenario, follow(planned, hidden), follow(swept, hidden))


def brute_force(
    start: ArrayLike,
    places: Sequence[PlaceRecord],
    *,
    target: str = "",
    travel: Travel | None = None,
) -> Plan:
    """The thesis' baseline: explore every place, always the nearest remaining centre next.

    Without relations, all places are equally probable. "Every place where it passes into"
    (section 4.4) is read as every place travelled to: see `lab/research/table_4_5.md`.
    """
    goals = [
        Goal(
            iri=place.iri,
            kind="place",
            label=place.label,
            p_map=np.array(place.area.centre),
            probability=1 / len(places),
            why=f"{place.label} is one of {len(places)} places, and brute force explores them all",
        )
        for place in places
    ]
    return nearest_first(start, goals, target=target, travel=travel)


def summarise(rows: Sequence[TableRow]) -> Summary:
    """Means and agreement with the published numbers over all rows."""
    t_r = fmean(row.ontology.seconds for row in rows)
    t_b = fmean(row.brute.seconds for row in rows)
    return Summary(
        rows=len(rows),
        equal_n_r=sum(_equal(row.ontology, row.scenario.published.n_r) for row in rows),
        equal_n_b=sum(_equal(row.brute, row.scenario.published.n_b) for row in rows),
        mean_t_r=t_r,
        mean_t_b=t_b,
        mean_ratio=fmean(row.ratio for row in rows),
        ratio_of_means=t_b / t_r,
    )


def _equal(outcome: RuleOutcome, published: int) -> bool:
    return outcome.found is not None and outcome.explored == published


def markdown(
    rows: Sequence[TableRow], fixes: Sequence[Erratum], uncorrected: Sequence[RowAgreement]
) -> str:
    """The whole of `lab/research/table_4_5.md`."""
    summary = summarise(rows)
    return "\n".join(
        [
            "# Table 4.5, computed",
            "",
            _ABOUT,
            "",
            "| searched | n_r | n_b | t_r [s] | t_b [s] | t_b / t_r |",
            "|---|---|---|---|---|---|",
            *(_line(row) for row in rows),
            "",
            f"| over all {summary.rows} | computed | published |",
            "|---|---|---|",
            *_summary_lines(summary, [row.scenario.published for row in rows]),
            "",
            "## Rows that contradict themselves",
            "",
            f"{len(fixes)} of the {summary.rows} rows were corrected, as listed below, partly by "
            "the published counts themselves.",
            "As they are printed the rows agree less:",
            "",
            "| rows | n_r equal | n_b equal |",
            "|---|---|---|",
            *(
                f"| {one.reading} | {one.n_r} of {summary.rows} | {one.n_b} of {summary.rows} |"
                for one in uncorrected
            ),
            f"| corrected | {summary.equal_n_r} of {summary.rows} "
            f"| {summary.equal_n_b} of {summary.rows} |",
            "",
            "| searched | what | printed | used | why |",
            "|---|---|---|---|---|",
            *(f"| {f.target} | {f.what} | {f.printed} | {f.used} | {f.why} |" for f in fixes),
            "",
        ]
    )


def _row_json(row: TableRow) -> dict[str, object]:
    return {
        "object": row.scenario.target,
        "n_r": row.ontology.explored,
        "n_b": row.brute.explored,
        "t_r": round(row.ontology.seconds, 2),
        "t_b": round(row.brute.seconds, 2),
        "published": asdict(row.scenario.published),
    }


def _line(row: TableRow) -> str:
    said = row.scenario.published
    return (
        f"| {row.scenario.target} | {_count(row.ontology.explored, said.n_r)} "
        f"| {_count(row.brute.explored, said.n_b)} "
        f"| {row.ontology.seconds:.1f} / {said.t_r:.1f} | {row.brute.seconds:.1f} / {said.t_b:.1f} "
        f"| {row.ratio:.2f} / {said.t_b / said.t_r:.2f} |"
    )


def _count(computed: int, published: int) -> str:
    return f"{computed} / {published}{'' if computed == published else ' *'}"


def _summary_lines(summary: Summary, published: Sequence[Published]) -> list[str]:
    t_r, t_b = fmean(p.t_r for p in published), fmean(p.t_b for p in published)
    ratio = fmean(p.t_b / p.t_r for p in published)
    return [
        f"| n_r equal, six rows corrected | {summary.equal_n_r} of {summary.rows} | |",
        f"| n_b equal, six rows corrected | {summary.equal_n_b} of {summary.rows} | |",
        f"| mean t_r [s] | {summary.mean_t_r:.2f} | {t_r:.2f} |",
        f"| mean t_b [s] | {summary.mean_t_b:.2f} | {t_b:.2f} |",
        f"| mean of t_b / t_r (the thesis' headline) | {summary.mean_ratio:.3f} | {ratio:.3f} |",
        f"| mean t_b / mean t_r | {summary.ratio_of_means:.3f} | {t_b / t_r:.3f} |",
    ]
