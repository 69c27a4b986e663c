"""Map a simulated house, query the map, and search for an object.

A simulated robot with a depth camera drives through a small furnished house. The command maps its
frames, answers three questions, then plans and runs a search. It writes demo.map/, map.ttl and
map.png.

example: hereabouts demo --folder /tmp/demo
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import count, declare
from hereabouts.cli.console import (
    heading,
    note,
    print_looks,
    print_table,
    progress,
    write,
    write_json,
)
from kg.model.shares import percent

if TYPE_CHECKING:
    from hereabouts.demo.house_demo import DemoProgress, DemoReport
    from kg.maps.query.evaluation import Table
    from mapping.reference.class_scores import MapScore


_OPTIONS = """
--folder DIR  folder for the results (default: here)
--seed N      seed of the simulated sensing errors (default: 0)
--replace     remove an earlier demo's map even if something was added to it
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, folder={"default": "."}, seed={"type": count, "default": 0})


def run(arguments: argparse.Namespace) -> int:
    from hereabouts.demo.house_demo import run_demo

    with progress() as bar:
        task = bar.add_task("map", total=None, status="")

        def on_progress(step: DemoProgress) -> None:
            bar.update(
                task,
                description=step.stage,
                completed=step.done,
                total=step.total,
                status=step.note,
            )

        report = run_demo(
            arguments.folder, on_progress, seed=arguments.seed, replace=arguments.replace
        )
    if arguments.json:
        write_json(report.to_json())
    else:
        _print(report)
    return 0


#: looks of the plan that are shown
_LOOKS: Final = 5
#: columns of answers that are shown
_SHOWN: Final = ("place", "label", "category", "belief", "x", "y", "z", "existence")


def _print(report: DemoReport) -> None:
    mapping = report.mapping
    heading(
        f"Mapped {report.rooms} rooms and {mapping.objects} objects in {mapping.seconds:.0f} s "
        f"({mapping.frames_per_second:.0f} frames/s)"
    )
    note(
        f"{_against_house(report.score)}; {report.rooms_right} of {report.rooms} rooms have the "
        "right category"
    )
    for answer in report.answers:
        parameters = "".join(f" -p {k}={_quoted(v)}" for k, v in answer.parameters.items())
        heading(answer.question)
        note(f"hereabouts ask {report.map_path} {answer.query}{parameters}")
        _print_answer(answer.table)
    _print_plan(report)
    _print_search(report)
    note(f"after the search, {_against_house(report.searched)}")
    heading("Results")
    write(f"{report.map_path}/  the map; ask it anything with hereabouts ask")
    write(f"{report.export_path}  the map as linked data, {report.triples:,} triples")
    write(f"{report.picture_path}  the map as a picture, with the search")
    write(f"try: hereabouts search {report.map_path} cup --robot sim")
    note(f"{report.seconds:.0f} s, {report.peak_memory:.0f} MB")


def _against_house(score: MapScore) -> str:
    return (
        f"compared with the house: {percent(score.recall or 0)} of its objects are in the map, "
        f"{percent(score.precision or 0)} of the objects in the map are real, and their median "
        f"position error is {100 * (score.position_error_median or 0):.0f} cm"
    )


def _print_answer(table: Table) -> None:
    shown = [i for i, column in enumerate(table.columns) if column in _SHOWN]
    print_table([table.columns[i] for i in shown], [[row[i] for i in shown] for row in table.rows])


def _print_plan(report: DemoReport) -> None:
    from hereabouts.demo.house_demo import TARGET
    from planner.search.plans.report import plan_lines, worthwhile

    plan = report.planned.plan
    heading(f"Where is the {TARGET}?")
    note(f"hereabouts find {report.map_path} {TARGET} {report.planned.options}")
    looks = min(worthwhile(plan.steps), _LOOKS)
    print_looks(plan, looks)
    note(plan_lines(plan, looks)[0])


def _print_search(report: DemoReport) -> None:
    from hereabouts.demo.demo_search import in_short
    from hereabouts.demo.house_demo import TARGET

    run = report.search
    heading(f"Meanwhile somebody brings home an {TARGET}. The robot searches for it")
    note(f"hereabouts search {report.map_path} {TARGET} --robot sim")
    print_table(
        ("seconds", "what happens"),
        [(round(seconds), line) for seconds, line in in_short(run.events)],
    )
    if report.position_error is None:
        write(f"The robot gave up after {run.outcome.seconds:.0f} s: {run.outcome.reason}.")
        return
    write(
        f"The robot found the {TARGET} in the {report.hidden_in} after {run.outcome.seconds:.0f} s "
        f"and {run.distance:.0f} m. The error of its position is "
        f"{100 * report.position_error:.0f} cm."
    )


def _quoted(value: object) -> str:
    return f"'{value}'" if " " in str(value) else str(value)
