"""Plan where to look for an object, in which order, and why.

The plan minimises the expected time until the object is found. The probability of each spot follows
from the map, common sense and statistics of rooms. OBJECT is a category, a synonym, a
supercategory, or a need such as 'something to sit on'. With several, the plan searches for all.

example: hereabouts find kitchen.map cup --from 0,0 --explain
"""

from __future__ import annotations

import argparse
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare, now_of, positive, seconds_of, share, speed
from hereabouts.cli.console import (
    heading,
    note,
    print_looks,
    print_plan,
    with_map,
    write,
    write_json,
)
from kg.model.errors import QueryParameterError
from planner.settings import WORTH

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from planner.freespace.grid import FreeSpace
    from planner.search.plans.find import PlannedSearch
    from planner.search.plans.view_plan import ViewPlan

_ROWS = 3  # looks that are printed; --explain prints all
_OBJECTS, _ALL = 2, 1000  # objects that are named, and with --explain
_LINES = 3  # of sentences and reasons together
_AHEAD = 60.0  # [s] by which clocks of robots may be ahead
_RULES = ("viewpoints", "nearest-first")
#: options of the rule "viewpoints" alone
_LOOKS_ONLY = (
    "budget",
    "worth",
    "turn_rate",
    "range",
    "recall",
    "now",
    "grid",
    "explain",
    "picture",
)


_OPTIONS = f"""
MAP
OBJECT ...         what to find, e.g. banana
--from
--budget TIME      time limit of the search: 300, 90s, 10min
--worth P          least chance of a look that is worth its time (default: {WORTH:g})
--speed M/S        driving speed
--turn-rate DEG/S  turning speed
--range NEAR,FAR   range of the camera [m] (0.8,4.6)
--recall R         probability to detect an object in view (0.7)
--now
--rule             planning rule (default: %(default)s); nearest-first is the thesis' rule,
                   brute-force its baseline
--grid FILE        floor as a map_server YAML file (default: the map's own)
--in-map TITLE     on a server with several maps: the map, by title or IRI, in whose frame the robot
                   is (default: the first)
--explain          print every step, and the facts of each reason once
--picture FILE     draw the plan: PNG, SVG or PDF
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _OPTIONS,
        budget=seconds_of,
        worth=share,
        speed=speed,
        turn_rate=positive,
        range=_range,
        recall=share,
        rule={"choices": _RULES, "default": _RULES[0]},
    )


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from planner.search.plans.report import empty_answer

    with open_map(arguments.map, read_only=True) as opened:
        semantic_map = opened.in_one_frame(arguments.in_map)
        objects, unseen = _wanted(semantic_map, arguments)
        if not objects:
            if arguments.json:
                now = now_of(semantic_map, arguments)
                write_json({**empty_answer(semantic_map, (), now), "undetectable": unseen})
            return 0
        code = _find(semantic_map, objects, unseen, arguments)
        if not arguments.json:
            from planner.search.goals.known_objects import elsewhere_lines

            for line in elsewhere_lines(opened, semantic_map, objects, arguments.map):
                write(line)
        return code


def _wanted(
    semantic_map: SemanticMap, arguments: argparse.Namespace
) -> tuple[list[str], list[dict[str, object]]]:
    """The objects to find; words that no category includes are answered, or their answers."""
    from planner.search.goals.targets import as_one, undetectable_target

    words = as_one(semantic_map, arguments.object)
    unseen = {text: undetectable_target(semantic_map, text) for text in words}
    answers = [answer for answer in unseen.values() if answer is not None]
    for answer in answers if not arguments.json else ():
        write(f"{answer.answer}.")
    return [text for text in words if unseen[text] is None], [one.to_json() for one in answers]


def _find(
    semantic_map: SemanticMap,
    objects: list[str],
    unseen: list[dict[str, object]],
    arguments: argparse.Namespace,
) -> int:
    if arguments.rule != _RULES[0]:
        return _by_reference(semantic_map, objects, arguments)
    found = _planned(semantic_map, objects, arguments)
    if arguments.picture and found.state is not None and found.plan is not None:
        from hereabouts.display.plots.search_plot import plot_plan

        path = plot_plan(semantic_map, found.state, found.plan, Path(arguments.picture))
        note(f"wrote {path}")
    if found.plan is not None and found.plan.note:
        note(found.plan.note)
    if arguments.json:
        write_json({**found.to_json(), "undetectable": unseen})
    elif found.plan is None:
        _without_floor(found, arguments)
    else:
        _print_found(found, found.plan, arguments)
    return 0


def _planned(
    semantic_map: SemanticMap, objects: list[str], arguments: argparse.Namespace
) -> PlannedSearch:
    from planner.search.plans.find import plan_words
    from planner.search.viewpoints.candidate_views import Motion, Sensor

    default, usual = Sensor(), Motion()
    near, far = arguments.range or (default.near, default.far)
    return plan_words(
        semantic_map,
        objects,
        now=now_of(semantic_map, arguments),
        start=arguments.start,
        budget=arguments.budget,
        worth=WORTH if arguments.worth is None else arguments.worth,
        sensor=Sensor(near=near, far=far, recall=arguments.recall or default.recall),
        motion=Motion(
            speed=arguments.speed or usual.speed,
            turn_rate=math.radians(arguments.turn_rate) if arguments.turn_rate else usual.turn_rate,
        ),
        space=_floor(semantic_map, Path(arguments.grid)) if arguments.grid else None,
    )


def _floor(semantic_map: SemanticMap, grid: Path) -> FreeSpace:
    from planner.freespace.map_server import space_of_grid
    from planner.freespace.planning_map import all_places

    return space_of_grid(grid, all_places(semantic_map))


def _print_found(found: PlannedSearch, plan: ViewPlan, arguments: argparse.Namespace) -> None:
    """Print the sentences about each target, and the looks or why there are none."""
    from planner.search.plans.report import nothing_line

    said = _print_known(found, arguments)
    if plan.steps:
        _print(plan, arguments, max(_LINES - said, 0))
    else:
        line = nothing_line(plan, arguments.budget)
        again = f"hereabouts find MAP {shlex.join(arguments.object)} --worth {plan.best / 2:.1g}"
        write(with_map(f"{line} (`{again}` plans all the same)" if plan.best > 0 else line))


def _print_known(found: PlannedSearch, arguments: argparse.Namespace) -> int:
    """Print the sentences about each target, and detections that made no object; their number."""
    from hereabouts.cli.candidates import detections_in_vain
    from kg.history.timestamps import iso
    from planner.search.plans.answer_sentences import find_sentences

    semantic_map, now, state = found.semantic_map, found.now, found.state
    assert state is not None and state.facts is not None  # it was planned on a map
    if state.facts.latest > now + _AHEAD:
        latest = iso(state.facts.latest)
        note(f"{iso(now)} lies before the last frame of the map ({latest})")
    lines = 0
    for target in found.targets:
        if target.note:
            note(target.note)
        most = _ALL if arguments.explain else _OBJECTS
        said = find_sentences(semantic_map, target, now, state, found.plan, most=most)
        if said[0].startswith("No "):
            vain = detections_in_vain(semantic_map, target.kind)
            said += [vain] if vain else []
        write(with_map("\n".join(said)))
        lines += len(said)
    return lines


def _print(found: ViewPlan, arguments: argparse.Namespace, reasons: int) -> None:
    from planner.search.plans.report import plan_lines, step_lines, worthwhile

    looks = None if arguments.explain else min(worthwhile(found.steps), _ROWS)
    if arguments.explain:
        heading("Where to look")
        write("\n".join(step_lines(found.steps)))
        heading("In all")
    else:
        print_looks(found, looks, reasons)
    write("\n".join(plan_lines(found, looks)))


def _by_reference(
    semantic_map: SemanticMap, objects: list[str], arguments: argparse.Namespace
) -> int:
    """The thesis' rule, on one target and without geometry."""
    from kg.maps.map_extent import check_positions
    from planner.search.plans.thesis_rules import Travel, plan_search
    from planner.search.plans.view_plan import robot_start

    if len(objects) > 1:
        raise QueryParameterError(
            f"--rule {arguments.rule} searches for one object at a time, got "
            f"{len(objects)}; --rule viewpoints takes several"
        )
    given = ["--" + n.replace("_", "-") for n in _LOOKS_ONLY if getattr(arguments, n)]
    if given:
        raise QueryParameterError(
            f"{' and '.join(given)} has no effect with --rule {arguments.rule}; "
            "use --rule viewpoints"
        )
    travel = Travel(speed=arguments.speed) if arguments.speed else None
    x, y, _ = arguments.start or robot_start(semantic_map.robot())
    if odd := check_positions(semantic_map.engine, [(x, y)], "start", QueryParameterError):
        note(odd)
    plan = plan_search(semantic_map, objects[0], (x, y), travel=travel)
    if arguments.json:
        write_json(plan.to_json())
    elif plan.steps:
        print_plan(plan)
    else:
        note(plan.explanation)
    return 0


def _without_floor(found: PlannedSearch, arguments: argparse.Namespace) -> None:
    """Print the reason why a map without floor has nowhere to look."""
    if arguments.start is not None:
        from kg.maps.map_extent import check_positions

        engine = found.semantic_map.engine
        check_positions(engine, [arguments.start[:2]], "start", QueryParameterError)
    for line in found.without_floor():
        write(line)


def _range(text: str) -> tuple[float, float]:
    try:
        near, far = (float(part) for part in text.split(","))
    except ValueError:
        near, far = math.nan, math.nan
    if not 0 <= near < far <= 100:
        raise argparse.ArgumentTypeError(
            f"needs NEAR,FAR in metres with 0 <= NEAR < FAR <= 100, e.g. 0.8,4.6; got {text!r}"
        )
    return near, far
