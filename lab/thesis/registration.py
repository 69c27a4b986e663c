"""Table 4.3: precision and recall of the objects in a map, by detector.

The thesis' recording of its institute is not at hand. The same count, object by object, is made of
a recording with a complete truth, by the thesis' rules and by the default ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hereabouts.cli import build_parser
from lab.cli.evaluated_maps import evaluated_maps
from lab.maps.complete_truth import load_complete_truth
from lab.maps.map_evaluation import evaluate_map
from lab.maps.truth_matching import Matching, TruthMatcher
from lab.thesis.scenarios import DATA, rows_of


@dataclass(frozen=True, slots=True)
class Registration:
    """Right, false and missed objects of a map, by class."""

    name: str
    right: Counter[str] = field(default_factory=Counter)
    false: Counter[str] = field(default_factory=Counter)
    missed: Counter[str] = field(default_factory=Counter)

    @property
    def labels(self) -> set[str]:
        """Classes with an object in the map or in the truth."""
        return set(self.right) | set(self.false) | set(self.missed)

    def cells(self, label: str | None = None) -> str:
        """TP, FP, FN, precision and recall of a class, or of the map, as cells of a table."""
        tp, fp, fn = (
            counted.total() if label is None else counted[label]
            for counted in (self.right, self.false, self.missed)
        )
        precision, recall = _share(tp, tp + fp), _share(tp, tp + fn)
        return f"{tp} | {fp} | {fn} | {precision} | {recall}"


def _share(part: int, whole: int) -> str:
    return f"{part / whole:.3f}" if whole else "-"


def printed() -> tuple[Registration, Registration]:
    """Table 4.3 as printed: YOLOv3 and SSD; raises LayoutError without the data."""
    rows = rows_of("table_4_3.csv", DATA)
    yolo, ssd = (
        Registration(
            name,
            *(
                Counter({row["object"]: int(row[f"{column}_{kind}"]) for row in rows})
                for kind in ("tp", "fp", "fn")
            ),
        )
        for name, column in (("YOLOv3", "yolov3"), ("SSD (Resnet 50)", "ssd"))
    )
    return yolo, ssd


def counted(name: str, matching: Matching, truth: Sequence[str]) -> Registration:
    """Registrations of a map matched to its truth, whose labels are `truth`.

    False are duplicates, wrong labels and objects near nothing; what the truth ignores is neither.
    """
    wrong = (*matching.duplicates, *matching.wrong, *matching.ghosts)
    return Registration(
        name,
        Counter(truth[pair.true] for pair in matching.matched),
        Counter(matching.mapped[pair.mapped].label for pair in wrong),
        Counter(truth[true] for true in matching.missed),
    )


def registrations(recording: Path, truth: Path, detectors: Sequence[str]) -> Iterator[Registration]:
    """Of one recording, mapped by the thesis' and by the default rules, with each detector.

    Objects with existence 0.5 and above, as maps show them. Raises RecordingError for what is no
    recording or no truth, ModelError for what is no detector.
    """
    entries = load_complete_truth(truth)
    labels = [entry.label for entry in entries]
    for detector in detectors:
        words = ["--recording", str(recording), "--truth", str(truth), "--detector", detector]
        arguments = build_parser(["evaluate"]).parse_args(
            ["evaluate", "map", *words, "--compare", "--scene", "none", "--no-floor"]
        )
        for evaluated in evaluated_maps(arguments):
            matcher = TruthMatcher(entries, evaluated.T_map_world)
            shown = evaluate_map(evaluated.semantic_map, matcher).shown
            mode = "thesis" if evaluated.run.mode == "reference" else "default"
            yield counted(f"{evaluated.run.detector}, {mode}", shown, labels)


def report(recording: Path, truth: Path, detectors: Sequence[str]) -> Iterator[str]:
    """Lines of Markdown: the printed table's totals above ours, and ours class by class."""
    ours = list(registrations(recording, truth, detectors))
    yield "| recording | map by | TP | FP | FN | precision | recall |"
    yield "|---|---|---|---|---|---|---|"
    for one in printed():
        yield f"| the thesis' institute, as published | {one.name} | {one.cells()} |"
    for one in ours:
        yield f"| {recording.name} | {one.name} | {one.cells()} |"
    yield ""
    yield f"| class | {' | '.join(one.name for one in ours)} |"
    yield "|---|" + "---|" * len(ours)
    for label in sorted(set().union(*(one.labels for one in ours))):
        cells = (f"{one.right[label]}, {one.false[label]}, {one.missed[label]}" for one in ours)
        yield f"| {label} | {' | '.join(cells)} |"
