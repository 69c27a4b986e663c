"""Pictures of an evaluation: a map against its truth, and the reliability of existence."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kg.model.errors import PictureError
from planner.cli.console import note
from planner.cli.evaluated_maps import EvaluatedMap, Run

if TYPE_CHECKING:
    from mapping.evaluation.map_evaluation import MapEvaluation, MapScores


def check_pictures(arguments: argparse.Namespace, truths: Sequence[object]) -> None:
    """Raise PictureError for a picture that cannot be drawn, before anything is mapped."""
    from planner.display.plots.picture_file import checked_ending

    for picture in filter(None, (arguments.picture, arguments.plot)):
        checked_ending(picture)
        for truth, path in zip(truths, arguments.truth, strict=True):
            if not isinstance(truth, tuple):
                raise PictureError(
                    f"{path} lists some classes only; {picture} needs a complete truth, whose "
                    "entries have also, ignore, extent or reach"
                )


def draw_truth(
    evaluated: EvaluatedMap, evaluation: MapEvaluation, arguments: argparse.Namespace
) -> None:
    """Draw one map against its truth; of several, each into a file of its own."""
    from mapping.occupancy.mapped_floor import mapped_floor
    from planner.display.plots.truth_plot import plot_truth

    robot = evaluated.semantic_map.robot()
    height = None if robot is None else float(robot.p_map[2])
    path = plot_truth(
        evaluation.shown,
        evaluation.matcher,
        _path(evaluated, arguments),
        title=evaluated.run.title,
        floor=mapped_floor(evaluated.semantic_map.floor(), height),
    )
    note(f"wrote {path}")


def draw_reliability(scored: Sequence[tuple[Run, MapScores]], path: Path) -> None:
    """Draw the calibration of all maps into one diagram."""
    from planner.display.plots.reliability_plot import plot_reliability

    calibrations = [(run.title, scores.calibration) for run, scores in scored]
    plot_reliability(calibrations, path, title="Reliability of existence")
    note(f"wrote {path}")


def _path(evaluated: EvaluatedMap, arguments: argparse.Namespace) -> Path:
    path = Path(arguments.picture)
    parts = [path.stem]
    if len(arguments.truth) > 1:
        parts += [str(evaluated.number + 1), evaluated.run.name]
    if arguments.compare:
        parts.append(evaluated.run.mode)
    return path.with_stem("-".join(parts))
