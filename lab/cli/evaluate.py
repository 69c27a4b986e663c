"""Score maps and networks against ground truth."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hereabouts.cli.arguments import MAP_HELP, count, declare, positive
from hereabouts.cli.console import note, print_table, write_json
from hereabouts.cli.mapping_options import MODES, add_all_arguments
from kg.model.errors import PictureError
from lab.cli.evaluate_networks import add_detector, add_scene
from lab.cli.evaluated_maps import EvaluatedMap, Run, check_usage, evaluated_maps

if TYPE_CHECKING:
    from lab.maps.complete_truth import TrueObject
    from lab.maps.map_evaluation import MapEvaluation, MapScores
    from lab.maps.session_identity import SessionIdentity
    from mapping.reference.class_scores import MapScore, Truth

    AnyTruth = Truth | tuple[TrueObject, ...]  # of some classes, or complete

_THRESHOLD_COLUMNS: Final = (
    *("threshold", "true", "mapped", "matched", "recall", "precision", "clean"),
    *("duplicates", "wrong", "ghosts", "ignored", "error"),
)
_POOLED: Final = "all"  # the name of pooled scores


@dataclass(frozen=True, slots=True)
class _Scored:
    """Scores of one map, by the kind of its truth."""

    run: Run
    by_class: MapScore | None = None
    evaluation: MapEvaluation | None = None

    def to_json(self) -> dict[str, Any]:
        scores = self.by_class or (self.evaluation and self.evaluation.scores())
        return self.run.to_json() | (scores.to_json() if scores else {})


def add(parser: argparse.ArgumentParser) -> None:
    subjects = parser.add_subparsers(dest="subject", metavar="SUBJECT", required=True)
    mapping = subjects.add_parser(
        "map",
        help="score the objects of maps, or of recordings, against hand-made truth",
        description="Score the objects of a map, or of a recording mapped into a temporary one. "
        "Matches are one to one, of the same class, and within 0.5 m (large things: 1.0 m). A "
        "complete truth (entries with also, ignore, extent or reach) is scored at several "
        "existence thresholds, with duplicates, wrong labels, ghosts, average precision, identity "
        "switches, calibration of existence and coverage of position ellipses.",
        epilog="example: hereabouts evaluate map --recording redkitchen --truth objects_gt.json",
    )
    mapping.add_argument("maps", metavar="MAP", nargs="*", help=MAP_HELP)
    mapping.add_argument(
        "--recording",
        action="append",
        metavar="DIR",
        help="recording to map and score; with MAP: the recording in whose world frame the truth "
        "is given (repeatable)",
    )
    mapping.add_argument(
        "--truth",
        action="append",
        required=True,
        metavar="FILE",
        help="objects_gt.json or objects_full_gt.json; one for each MAP or recording",
    )
    mapping.add_argument(
        "--near",
        type=positive,
        default=0.5,
        metavar="M",
        help="complete truth: maximum distance of a match, except of large things (default: 0.5)",
    )
    mapping.add_argument(
        "--compare",
        action="store_true",
        help=f"map by each mode ({', '.join(MODES)}); the networks run once",
    )
    mapping.add_argument(
        "--sessions",
        type=count,
        default=1,
        metavar="N",
        help="treat each N recordings in a row as sessions of one place: map them into one map, "
        "score it after each, and score whether objects keep their identity",
    )
    mapping.add_argument(
        "--picture",
        metavar="FILE",
        help="draw map and truth from above; several maps: a file each, with the map's name added",
    )
    mapping.add_argument(
        "--plot",
        metavar="FILE",
        help="draw the reliability diagram of existence for all maps",
    )
    declare(mapping, "--json")
    add_all_arguments(mapping)
    mapping.set_defaults(run=run_map)
    add_detector(subjects)
    add_scene(subjects)


def run_map(arguments: argparse.Namespace) -> int:
    """Map where needed, score, print."""
    check_usage(arguments)
    truths = [_load(Path(path)) for path in arguments.truth]
    _check_pictures(arguments, truths)
    if arguments.sessions > 1:
        _check_sessions(arguments, truths)
    scored = []
    for evaluated in evaluated_maps(arguments):
        scored.append(_score(evaluated, truths[evaluated.number], arguments.near))
        if arguments.picture and (evaluation := scored[-1].evaluation):
            _draw_truth(evaluated, evaluation, arguments)
    pooled = _pooled(scored) if len(arguments.truth) > 1 else {}
    together = [(Run(_POOLED, mode), scores) for mode, scores in pooled.items()]
    complete = [(one.run, one.evaluation.scores()) for one in scored if one.evaluation]
    identities = _identities(scored, arguments.sessions)
    if arguments.plot:
        _draw_reliability(together or complete, Path(arguments.plot))
    if arguments.json:
        pooled_json = [{"mode": mode} | scores.to_json() for mode, scores in pooled.items()]
        found = [{"sessions": name} | one.to_json() for name, one in identities]
        write_json(
            {"runs": [one.to_json() for one in scored], "pooled": pooled_json}
            | ({"identity": found} if found else {})
        )
    else:
        _print(scored, complete + together)
        _print_identities(identities)
    return 0


def _check_pictures(arguments: argparse.Namespace, truths: Sequence[object]) -> None:
    """Raise PictureError for a picture that cannot be drawn, before anything is mapped."""
    from hereabouts.display.plots.picture_file import checked_ending

    for picture in filter(None, (arguments.picture, arguments.plot)):
        checked_ending(picture)
        for truth, path in zip(truths, arguments.truth, strict=True):
            if not isinstance(truth, tuple):
                raise PictureError(
                    f"{path} lists some classes only; {picture} needs a complete truth, whose "
                    "entries have also, ignore, extent or reach"
                )


def _draw_truth(
    evaluated: EvaluatedMap, evaluation: MapEvaluation, arguments: argparse.Namespace
) -> None:
    """Draw one map against its truth; each of several maps has a file of its own."""
    from lab.plots.truth_plot import plot_truth
    from mapping.occupancy.mapped_floor import mapped_floor

    path = Path(arguments.picture)
    parts = [path.stem]
    if len(arguments.truth) > 1:
        parts += [str(evaluated.number + 1), evaluated.run.name]
    if arguments.compare:
        parts.append(evaluated.run.mode)
    robot = evaluated.semantic_map.robot()
    height = None if robot is None else float(robot.p_map[2])
    path = plot_truth(
        evaluation.shown,
        evaluation.matcher,
        path.with_stem("-".join(parts)),
        title=evaluated.run.title,
        floor=mapped_floor(evaluated.semantic_map.floor(), height),
    )
    note(f"wrote {path}")


def _draw_reliability(scored: Sequence[tuple[Run, MapScores]], path: Path) -> None:
    """Draw the calibration of all maps into one diagram."""
    from lab.plots.reliability_plot import plot_reliability

    calibrations = [(run.title, scores.calibration) for run, scores in scored]
    plot_reliability(calibrations, path, title="Reliability of existence")
    note(f"wrote {path}")


def _load(path: Path) -> AnyTruth:
    """Read a truth of either kind; raises RecordingError."""
    from lab.maps.complete_truth import is_complete_truth, load_complete_truth
    from lab.maps.truth_matching import load_truth

    return load_complete_truth(path) if is_complete_truth(path) else load_truth(path)


def _score(evaluated: EvaluatedMap, truth: AnyTruth, near: float) -> _Scored:
    from lab.maps.map_evaluation import evaluate_map
    from lab.maps.truth_matching import TruthMatcher
    from mapping.reference.class_scores import score_map

    semantic_map, T_map_world = evaluated.semantic_map, evaluated.T_map_world
    if isinstance(truth, tuple):
        matcher = TruthMatcher(truth, T_map_world, near)
        evaluation = evaluate_map(semantic_map, matcher, evaluated.since)
        return _Scored(evaluated.run, evaluation=evaluation)
    label = semantic_map.catalogue.label
    found = [(label(record.category), record.p_map) for record in semantic_map.objects()]
    return _Scored(evaluated.run, by_class=score_map(found, truth, T_map_world))


def _pooled(scored: Sequence[_Scored]) -> dict[str, MapScores]:
    """Mode -> scores of all its maps together; empty if a truth is not complete."""
    from lab.maps.map_evaluation import pooled

    if any(one.evaluation is None for one in scored):
        return {}
    modes = dict.fromkeys(one.run.mode for one in scored)
    return {
        mode: pooled([one.evaluation for one in scored if one.evaluation and one.run.mode == mode])
        for mode in modes
    }


def _check_sessions(arguments: argparse.Namespace, truths: Sequence[AnyTruth]) -> None:
    for truth, path in zip(truths, arguments.truth, strict=True):
        if not isinstance(truth, tuple):
            arguments.usage_error(
                f"{path} lists some classes only; --sessions needs complete truths"
            )


def _identities(scored: Sequence[_Scored], sessions: int) -> list[tuple[str, SessionIdentity]]:
    """Identity from each session to the next, and pooled over each mode if it has several."""
    from lab.maps.session_identity import pooled_identity, session_identity

    found: list[tuple[str, SessionIdentity]] = []
    by_mode: dict[str, list[SessionIdentity]] = {}
    for number, (one, other) in enumerate(pairwise(scored), start=1):
        if one.evaluation and other.evaluation and number % sessions:
            ends = [(e.shown, e.matcher) for e in (one.evaluation, other.evaluation)]
            identity = session_identity(*ends)
            names = ", ".join((f"{one.run.name} to {other.run.name}", one.run.mode))
            found.append((names, identity))
            by_mode.setdefault(one.run.mode, []).append(identity)
    if len(found) > len(by_mode):
        found += [(f"{_POOLED}, {mode}", pooled_identity(all_)) for mode, all_ in by_mode.items()]
    return found


def _print(scored: Sequence[_Scored], complete: Sequence[tuple[Run, MapScores]]) -> None:
    for one in scored:
        if one.by_class is not None:
            _print_by_class(one.run, one.by_class)
    if complete:
        _print_complete(complete)


def _print_by_class(run: Run, score: MapScore) -> None:
    print_table(
        ("class", "truth", "mapped", "matched", "duplicates", "median error [m]"),
        [
            (label, c.truth, c.mapped, c.matched, c.duplicates, c.position_error_median)
            for label, c in score.per_class.items()
        ],
        title=run.title,
    )
    columns = ("precision", "recall", "median error [m]", "duplicates", "frames/s")
    totals = (score.precision, score.recall, score.position_error_median, score.duplicates)
    print_table(columns, [(*totals, run.report and run.report.frames_per_second)])
    note(f"precision counts only classes whose truth is complete: {', '.join(score.complete_for)}")


def _print_complete(scored: Sequence[tuple[Run, MapScores]]) -> None:
    """A table of scores by threshold, and one of scores without a threshold."""
    modes = any(run.mode for run, _ in scored)
    names = ("map", "mode") if modes else ("map",)
    rows = [
        (*_cells(run, modes), *(getattr(score, column) for column in _THRESHOLD_COLUMNS))
        for run, scores in scored
        for score in scores.thresholds
    ]
    print_table((*names, *_THRESHOLD_COLUMNS), rows)
    columns = (
        *("AP", "best F1", "identity switches", "ECE"),
        *("ellipse 95 %", "ellipsoid 95 %", "frames/s"),
    )
    rows = [
        (
            *_cells(run, modes),
            scores.average_precision,
            scores.best_f1,
            scores.switches,
            scores.calibration.ece,
            scores.coverage.ellipse,
            scores.coverage.ellipsoid,
            run.report and run.report.frames_per_second,
        )
        for run, scores in scored
    ]
    print_table((*names, *columns), rows)
    relations = ("relation", "true", "stated", "right", "recall", "precision", "ECE")
    rows = [
        (*_cells(run, modes), r.kind, r.true, r.stated, r.right, r.recall, r.precision, r.ece)
        for run, scores in scored
        for r in scores.relations
    ]
    if rows:
        print_table((*names, *relations), rows)


def _print_identities(found: Sequence[tuple[str, SessionIdentity]]) -> None:
    if not found:
        return
    columns = ("things", "objects", "right", "wrong", "recall", "precision", "f1")
    rows = [
        (name, kind, *(getattr(score, column) for column in columns))
        for name, one in found
        for kind, score in (("all", one.everything), ("moved", one.moved))
    ]
    print_table(("identity", "of", *columns), rows)


def _cells(run: Run, modes: bool) -> tuple[str, ...]:
    return (run.name, run.mode) if modes else (run.name,)
