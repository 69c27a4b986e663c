"""`hereabouts evaluate detector` and `evaluate scene`: networks scored on labelled photographs."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import count, declare
from hereabouts.cli.console import note, print_table, progress, write_json
from hereabouts.cli.models import named_detector

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from lab.networks.detector_evaluation import DetectorEvaluation
    from lab.networks.scene_evaluation import SceneEvaluation

_Subjects = Any  # argparse has no public name for this type
_MAX_NAMED = 5  # labels in one note


def add_detector(subjects: _Subjects) -> None:
    """Declare `evaluate detector`."""
    parser = subjects.add_parser(
        "detector",
        help="score detectors on photographs with true boxes, as COCO does",
        description="Average precision (AP) and recall (AR) of detectors on a COCO data set: the "
        "numbers of pycocotools, with at most 100 detections of a class in an image.",
        epilog="example: hereabouts evaluate detector --coco coco/annotations/"
        "instances_val2017.json --detector mine.onnx",
    )
    parser.add_argument(
        "--coco",
        required=True,
        metavar="DIR|FILE",
        help="folder with instances.json and images/, folder of COCO, or annotation file",
    )
    parser.add_argument(
        "--detector",
        action="append",
        metavar="NAME|FILE",
        help="detector to score, or best; repeatable (default: the two bundled ones)",
    )
    declare(parser, "--device")
    parser.add_argument(
        "--limit", type=count, metavar="N", help="the first N images only (default: all)"
    )
    parser.add_argument(
        "--results", metavar="FILE", help="write the detections of one detector as COCO results"
    )
    declare(parser, "--json")
    parser.set_defaults(run=run_detector, usage_error=parser.error)


def add_scene(subjects: _Subjects) -> None:
    """Declare `evaluate scene`."""
    parser = subjects.add_parser(
        "scene",
        help="score scene classifiers on photographs in a folder for each class",
        description="Top-1, top-5, confusion and calibration of scene classifiers on photographs.",
        epilog="example: hereabouts evaluate scene --images places365/val --scene mine.onnx",
    )
    parser.add_argument(
        "--images",
        required=True,
        metavar="DIR",
        help="folder with one folder of images a class",
    )
    parser.add_argument(
        "--scene",
        action="append",
        metavar="NAME|FILE",
        help="scene classifier to score; repeatable (default: the bundled one)",
    )
    declare(parser, "--device")
    declare(parser, "--json")
    parser.set_defaults(run=run_scene)


def run_detector(arguments: argparse.Namespace) -> int:
    """Run the detectors on the photographs, and print their scores."""
    from lab.networks.coco_dataset import load_coco
    from lab.networks.detector_evaluation import THRESHOLD, evaluate_detector
    from perception.inference.detector import load_detector
    from perception.inference.model_zoo import bundled_pair

    names = arguments.detector or bundled_pair()
    if arguments.results and len(names) > 1:
        arguments.usage_error("--results takes the detections of one --detector")
    dataset = load_coco(Path(arguments.coco))
    detectors = [
        load_detector(named_detector(name), threshold=THRESHOLD, device=arguments.device)
        for name in names
    ]
    found = []
    with progress() as bar:
        for detector in detectors:
            total = min(len(dataset), arguments.limit or len(dataset))
            task = bar.add_task(detector.name, total=total, status="")
            evaluation = evaluate_detector(
                detector,
                dataset,
                images=arguments.limit or None,
                results=Path(arguments.results) if arguments.results else None,
                on_image=partial(_advance, bar, task),
            )
            found.append(evaluation)
    if arguments.json:
        write_json([one.to_json() for one in found])
    else:
        _print_detectors(found)
    return 0


def run_scene(arguments: argparse.Namespace) -> int:
    """Run the scene classifiers on the photographs, and print their scores."""
    from lab.networks.scene_evaluation import evaluate_scenes, labelled_images
    from perception.inference.scene_classifier import load_scene_classifier

    folder = Path(arguments.images)
    classifiers = [
        load_scene_classifier(name, device=arguments.device)
        for name in arguments.scene or ["default"]
    ]
    total = sum(1 for _ in labelled_images(folder))
    found = []
    with progress() as bar:
        for classifier in classifiers:
            task = bar.add_task(classifier.name, total=total, status="")
            evaluation = evaluate_scenes(
                classifier,
                folder,
                on_image=partial(_advance, bar, task),
            )
            found.append(evaluation)
    if arguments.json:
        write_json([one.to_json() for one in found])
    else:
        _print_scenes(found)
    return 0


def _advance(bar: Progress, task: TaskID, done: int) -> None:
    bar.update(task, completed=done)


def _print_detectors(found: list[DetectorEvaluation]) -> None:
    """Each detector's mean scores in one table, and its scores of each class in another."""
    columns = ("ap", "ap50", "ap75", "ap_small", "ap_medium", "ap_large", "ar")
    print_table(
        ("detector", "images", "boxes", "AP", "AP50", "AP75", "small", "medium", "large", "AR"),
        [
            (one.detector, s.images, s.true, *(getattr(s, column) for column in columns))
            for one in found
            for s in (one.scores,)
        ],
    )
    scores = ("ap", "ap50", "ar") if len(found) == 1 else ("ap",)
    names = ("AP", "AP50", "AR") if len(found) == 1 else [one.detector for one in found]
    rows = [
        (same[0].name, same[0].true, *(getattr(one, score) for one in same for score in scores))
        for same in zip(*(one.scores.classes for one in found), strict=True)
        if same[0].true
    ]
    title = "average precision of each class" if len(found) > 1 else None
    print_table(("class", "boxes", *names), rows, title=title)
    for one in found:
        if one.unknown_labels:
            labels = list(one.unknown_labels)
            more = f" and {len(labels) - _MAX_NAMED} more" if len(labels) > _MAX_NAMED else ""
            listed = ", ".join(labels[:_MAX_NAMED]) + more
            note(f"{one.detector}: left out, since they are no class of the data set: {listed}")


def _print_scenes(found: list[SceneEvaluation]) -> None:
    """Each classifier's shares in one table, and its confusion in another."""
    print_table(
        ("scene classifier", "images", "top-1", "top-5", "ECE"),
        [(one.classifier, one.images, one.top1, one.top5, one.calibration.ece) for one in found],
    )
    for one in found:
        answered = sorted({name for row in one.confusion.values() for name in row})
        rows = [
            (name, sum(row.values()), *(row.get(other, 0) for other in answered))
            for name, row in one.confusion.items()
        ]
        title = f"{one.classifier}: images of each class (rows) by answer (columns)"
        if len(answered) > 2 * len(one.confusion) + 4:  # too wide to read
            rows = [
                (name, sum(row.values()), row.get(name, 0), _most_frequent(name, row))
                for name, row in one.confusion.items()
            ]
            answered = ["right", "most often instead"]
        print_table(("class", "images", *answered), rows, title=title)
        if one.unknown:
            listed = ", ".join(f"{name} ({images})" for name, images in one.unknown.items())
            note(f"{one.classifier} does not know these classes, left out: {listed}")


def _most_frequent(name: str, row: dict[str, int] | Any) -> str:
    """The wrong answers of a class with their counts, most frequent first."""
    wrong = sorted(((n, other) for other, n in row.items() if other != name), reverse=True)
    return ", ".join(f"{other} {n}" for n, other in wrong[:3])
