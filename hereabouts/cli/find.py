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
from dataclasses import dataclass
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
    from planner.search.goals.search_facts import SearchFacts
    from planner.search.plans.search_state import PlanningState
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


@dataclass(frozen=True, slots=True)
class _Wanted:
    """Objects to find, and the answers for words that no category includes."""

    objects: list[str]
    undetectable: list[dict[str, object]]

    def write_json(self, answer: dict[str, object]) -> None:
        write_json({**answer, "undetectable": self.undetectable})


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
        wanted = _wanted(semantic_map, arguments)
        if not wanted.objects:
            if arguments.json:
                now = now_of(semantic_map, arguments)
                wanted.write_json(empty_answer(semantic_map, (), now))
            return 0
        code = _find(semantic_map, wanted, arguments)
        if not arguments.json:
            from planner.search.goals.known_objects import elsewhere_lines

            for line in elsewhere_lines(opened, semantic_map, wanted.objects, arguments.map):
                write(line)
        return code


def _wanted(semantic_map: SemanticMap, arguments: argparse.Namespace) -> _Wanted:
    """The objects to find; words that no category includes are answered."""
    from planner.search.goals.targets import as_one, undetectable_target

    words = as_one(semantic_map, arguments.object)
    unseen = {text: undetectable_target(semantic_map, text) for text in words}
    answers = [answer for answer in unseen.values() if answer is not None]
    for answer in answers if not arguments.json else ():
        write(f"{answer.answer}.")
    return _Wanted(
        [text for text in words if unseen[text] is None], [answer.to_json() for answer in answers]
    )


def _find(semantic_map: SemanticMap, wanted: _Wanted, arguments: argparse.Namespace) -> int:
    if arguments.rule != _RULES[0]:
        return _by_reference(semantic_map, wanted.objects, arguments)
    state = _planning_state(semantic_map, wanted.objects, arguments)
    if state is None:
        return _without_floor(semantic_map, wanted, arguments)
    return _by_viewpoints(semantic_map, state, wanted, arguments)


def _planning_state(
    semantic_map: SemanticMap, objects: list[str], arguments: argparse.Namespace
) -> PlanningState | None:
    from planner.search.plans.search_state import build_search
    from planner.search.viewpoints.candidate_views import Motion, Sensor

    default, usual = Sensor(), Motion()
    near, far = arguments.range or (default.near, default.far)
    return build_search(
        semantic_map,
        objects,
        sensor=Sensor(near=near, far=far, recall=arguments.recall or default.recall),
        motion=Motion(
            speed=arguments.speed or usual.speed,
            turn_rate=math.radians(arguments.turn_rate) if arguments.turn_rate else usual.turn_rate,
        ),
        space=_floor(semantic_map, Path(arguments.grid)) if arguments.grid else None,
        at=now_of(semantic_map, arguments),
        start=arguments.start and arguments.start[:2],
    )


def _floor(semantic_map: SemanticMap, grid: Path) -> FreeSpace:
    from planner.freespace.map_server import space_of_grid
    from planner.freespace.planning_map import all_places

    return space_of_grid(grid, all_places(semantic_map))


def _by_viewpoints(
    semantic_map: SemanticMap, state: PlanningState, wanted: _Wanted, arguments: argparse.Namespace
) -> int:
    from planner.search.plans.report import answer_json, nothing_line
    from planner.search.plans.view_plan import plan_from

    found = plan_from(
        state,
        arguments.start,
        budget=arguments.budget,
        worth=WORTH if arguments.worth is None else arguments.worth,
    )
    if arguments.picture:
        from hereabouts.display.plots.search_plot import plot_plan

        path = plot_plan(semantic_map, state, found, Path(arguments.picture))
        note(f"wrote {path}")
    facts = state.facts
    assert facts is not None  # it was planned on a map
    if found.note:
        note(found.note)
    if arguments.json:
        wanted.write_json(answer_json(semantic_map, state, found, facts.now))
        return 0
    said = _print_known(semantic_map, facts, arguments, state, found)
    if not found.steps:
        line = nothing_line(found, arguments.budget)
        again = f"hereabouts find MAP {shlex.join(arguments.object)} --worth {found.best / 2:.1g}"
        write(with_map(f"{line} (`{again}` plans all the same)" if found.best > 0 else line))
    else:
        _print(found, arguments, max(_LINES - said, 0))
    return 0


def _print_known(
    semantic_map: SemanticMap,
    facts: SearchFacts,
    arguments: argparse.Namespace,
    state: PlanningState,
    found: ViewPlan,
) -> int:
    """Print the sentences about each target, and detections that made no object; their number."""
    from hereabouts.cli.candidates import detections_in_vain
    from kg.history.timestamps import iso
    from planner.search.plans.answer_sentences import find_sentences

    now = facts.now
    if facts.latest > now + _AHEAD:
        note(f"{iso(now)} lies before the last frame of the map ({iso(facts.latest)})")
    lines = 0
    for target in facts.targets:
        if target.note:
            note(target.note)
        most = _ALL if arguments.explain else _OBJECTS
        said = find_sentences(semantic_map, target, now, state, found, most=most)
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


def _without_floor(
    semantic_map: SemanticMap, wanted: _Wanted, arguments: argparse.Namespace
) -> int:
    """Print the known facts, and the reason why a map without floor has nowhere to look."""
    from planner.search.goals.search_goals import explain_none
    from planner.search.goals.targets import resolve
    from planner.search.plans.report import empty_answer

    targets = resolve(semantic_map, wanted.objects)
    now = now_of(semantic_map, arguments)
    if arguments.json:
        wanted.write_json(empty_answer(semantic_map, targets, now))
        return 0
    if arguments.start is not None:
        from kg.maps.map_extent import check_positions

        check_positions(semantic_map.engine, [arguments.start[:2]], "start", QueryParameterError)
    for iri in (iri for target in targets for iri in target.queried):
        write(explain_none(semantic_map, iri))
    return 0


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
