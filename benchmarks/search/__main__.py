"""`python -m benchmarks.search`: things searched for in real homes, by five ways of searching."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import count, declare, positive, share, speed
from hereabouts.cli.console import heading, note, print_table, progress, write_json
from lab import command_line
from planner.settings import BELIEF

if TYPE_CHECKING:
    from benchmarks.search.scores import Score
    from benchmarks.search.trial import Searched, TrialSettings

_FURTHEST = 100.0  # [m] that a camera may see


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.search",
        description="Hide every object of every home, and search for it with the same robot, "
        "camera and luck: ours, the thesis' rule, a greedy walk, brute force, one that knows where "
        "it is, and the same without pictures on the way "
        "(lab/research/search_trials.md).",
        epilog="example: python -m benchmarks.search --homes homes --json",
    )
    parser.add_argument("--homes", required=True, metavar="DIR", help="homes, one JSON file each")
    parser.add_argument(
        "--rooms",
        metavar="CSV",
        help="rooms of real homes counted; the home searched is taken out "
        "(default: the knowledge that ships)",
    )
    parser.add_argument(
        "--apart", action="store_true", help="the statistics do not count these homes"
    )
    parser.add_argument("--queries", type=count, metavar="N", help="at most N of them, evenly")
    parser.add_argument("--seed", type=count, default=0, metavar="N", help="(default: 0)")
    parser.add_argument("--recall", type=share, default=0.7, metavar="P", help="(default: 0.7)")
    parser.add_argument("--far", type=positive, default=4.6, metavar="M", help="(default: 4.6)")
    parser.add_argument("--speed", type=speed, metavar="M/S", help="of the robot (default: 0.2412)")
    parser.add_argument(
        "--give-up-at",
        type=share,
        default=BELIEF.stop_below,
        metavar="P",
        help="ours gives up once looks would have missed a thing by a chance of P only "
        f"(default: {BELIEF.stop_below:g})",
    )
    parser.add_argument("--robustness", action="store_true", help="also with beliefs that mislead")
    parser.add_argument(
        "--calibration",
        action="store_true",
        help="instead: chances of being found that plans predict beside the realised ones",
    )
    parser.add_argument(
        "--processes", type=count, default=2, metavar="N", help="homes at a time (default: 2)"
    )
    declare(parser, "--json")
    return command_line.run(parser, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Search, score, print."""
    from benchmarks.search.report import report
    from benchmarks.search.trial import run as search_all

    settings = _settings(arguments)
    with progress() as bar:
        task = bar.add_task("homes", total=None, status="")
        searched = search_all(
            Path(arguments.homes),
            settings,
            lambda home, done, of: bar.update(task, completed=done, total=of, status=home),
        )
    if settings.calibration:
        _print_calibration(searched, as_json=arguments.json)
        return 0
    scores = report(searched, settings)
    if arguments.json:
        write_json(scores.to_json())
        return 0
    _print(scores.methods)
    heading("without pictures on the way")
    _print(scores.silent)
    if scores.parts:
        heading("ours without some of its parts")
        _print(scores.parts)
    if scores.robustness:
        heading("ours with beliefs that mislead")
        _print(scores.robustness)
    for line in scores.ratios():
        note(line)
    return 0


def _settings(arguments: argparse.Namespace) -> TrialSettings:
    from benchmarks.search.trial import TrialSettings
    from planner.search.viewpoints.candidate_views import Motion, Sensor

    near = Sensor().near
    if not near < arguments.far <= _FURTHEST:
        arguments.usage_error(
            f"--far must be more than {near:g} m, the nearest seen, and up to {_FURTHEST:g} m"
        )
    if arguments.queries == 0 or arguments.processes == 0:
        arguments.usage_error("--queries and --processes must be 1 or more")
    return TrialSettings(
        sensor=Sensor(far=arguments.far, recall=arguments.recall),
        motion=Motion(speed=arguments.speed) if arguments.speed else Motion(),
        rooms=Path(arguments.rooms) if arguments.rooms else None,
        apart=arguments.apart,
        seed=arguments.seed,
        queries=arguments.queries,
        robustness=arguments.robustness,
        calibration=arguments.calibration,
        give_up_at=arguments.give_up_at,
        processes=arguments.processes,
    )


def _print_calibration(searched: Sequence[Searched], *, as_json: bool) -> None:
    from benchmarks.search.plan_calibration import PARTS, reliability

    scores = reliability([one.planned for one in searched if one.planned is not None])
    if as_json:
        write_json({"parts": PARTS, **{name: asdict(one) for name, one in scores.items()}})
        return
    for name, one in scores.items():
        heading(f"{name}: {one.plans} plans")
        rows = zip(PARTS, one.predicted, one.found, strict=True)
        print_table(
            ("part of the plan", "predicted", "found"),
            [(f"{part:.0%}", f"{chance:.3f}", f"{found:.3f}") for part, chance, found in rows],
        )


def _print(scores: Mapping[str, Score]) -> None:
    print_table(
        (
            *("", "success", "mean s", "found s", "median s", "worst tenth"),
            *("metres", "SPL", "AUC", "looks", "queries"),
        ),
        [
            (
                method,
                f"{s.success:.3f}",
                f"{s.mean_seconds:.1f}",
                "" if s.mean_seconds_found is None else f"{s.mean_seconds_found:.1f}",
                f"{s.median_seconds:.1f}",
                f"{s.worst_tenth_seconds:.1f}",
                f"{s.mean_metres:.1f}",
                f"{s.spl:.3f}",
                f"{s.auc:.3f}",
                f"{s.mean_looks:.1f}",
                s.queries,
            )
            for method, s in scores.items()
        ],
    )


if __name__ == "__main__":
    sys.exit(main())
