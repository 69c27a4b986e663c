"""List, download, check and locate networks.

Two networks come with hereabouts; others can be downloaded.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import add_json
from hereabouts.cli.console import note, print_table, printable, progress, write, write_json

if TYPE_CHECKING:
    from perception.inference.detector import OnnxDetector
    from perception.inference.model_zoo import ModelCard


def add(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="all known networks, with licence and quality")
    add_json(listing)
    listing.set_defaults(run=run_list)
    fetch = actions.add_parser("fetch", help="download a network, resuming and checking it")
    fetch.add_argument(
        "name", metavar="NAME", help="a name of `models list`, or best for the best detector"
    )
    fetch.set_defaults(run=run_fetch)
    check = actions.add_parser("check", help="list what a detector can see, and what it cannot")
    check.add_argument(
        "file", metavar="FILE", help="a detector (.onnx, or a name), or a list of labels (.txt)"
    )
    check.add_argument(
        "image", metavar="IMAGE", nargs="?", help="a photograph, to draw what the detector finds"
    )
    check.add_argument("--labels", metavar="FILE", help="labels of the detector, one a line")
    check.add_argument(
        "--head", metavar="NAME", help="meaning of its outputs, where an error names two"
    )
    add_json(check)
    check.set_defaults(run=run_check)
    path = actions.add_parser("path", help="print the path of a network's file")
    path.add_argument("name", metavar="NAME")
    path.set_defaults(run=run_path)


def run_list(arguments: argparse.Namespace) -> int:
    """List the networks."""
    from perception.inference.model_zoo import extension_cards, known_models

    models = (*known_models(), *extension_cards())
    if arguments.json:
        write_json([model.to_json() for model in models])
        return 0
    print_table(
        ("name", "kind", "here", "MB", "licence", "quality"),
        [
            (
                m.name,
                m.kind,
                m.where,
                f"{m.size / 1e6:.1f}" if m.size else "-",
                m.licence,
                m.quality,
            )
            for m in models
        ],
    )
    return 0


def run_fetch(arguments: argparse.Namespace) -> int:
    """Download a network."""
    from perception.inference.model_zoo import best_detector, find_model

    write(str(_fetch(best_detector() if arguments.name == "best" else find_model(arguments.name))))
    return 0


def named_detector(name: str) -> str:
    """`name`, or for "best" the name of the best detector, which is fetched if needed."""
    from kg.model.errors import ModelError
    from perception.inference.model_zoo import best_detector

    if name != "best":
        return name
    best = best_detector()
    if best.where == "to fetch":
        try:
            _fetch(best)
        except ModelError as error:
            raise ModelError(f"{error}; without --detector {name} the bundled ones run") from error
    return best.name


def _fetch(model: ModelCard) -> Path:
    """Download a network under a progress bar; its file."""
    from perception.inference.model_zoo import fetch_model

    with progress() as bar:
        task = bar.add_task(model.name, total=model.size or None, status="bytes")
        path = fetch_model(model.name, on_progress=lambda n: bar.update(task, completed=n))
    note(f"{model.name}: licence {model.licence}")
    return path


def run_check(arguments: argparse.Namespace) -> int:
    """List the labels of a detector with the categories that they get in a map."""
    from kg.knowledge.ontology.shipped import shipped_ontology
    from mapping.labels.label_resolver import check_labels
    from perception.inference.class_labels import is_object, read_labels
    from perception.inference.detector import load_detector

    if arguments.file.endswith(".txt"):
        labels = read_labels(Path(arguments.file))
    else:
        given = Path(arguments.labels) if arguments.labels else None
        detector = load_detector(named_detector(arguments.file), labels=given, head=arguments.head)
        if arguments.image is not None:
            _draw(detector, Path(arguments.image))  # its labels are clear from then on
        labels = detector.labels
    found = check_labels(
        [label for label in labels if is_object(label)], shipped_ontology().catalogue
    )
    if arguments.json:
        write_json(asdict(found))
        return 0
    rows = [(printable(one.label), one.way, one.category) for one in found.labels]
    print_table(("label", "becomes", "category, or the one above"), rows)
    counts = Counter(one.way for one in found.labels)
    note(", ".join(f"{counts[way]} {way}" for way in counts))
    if found.unseen:
        note(f"it cannot see: {', '.join(found.unseen)}")
    return 0


def _draw(detector: OnnxDetector, path: Path) -> None:
    """Draw what a detector finds in an image file beside it, and tell how it was read."""
    import numpy as np

    from perception.annotate import draw_detections, save_image
    from perception.frames import Frame
    from perception.sources.folders.image_files import read_colour

    rgb = read_colour(path)
    found = detector.detect_image(rgb)
    depth = np.full(rgb.shape[:2], np.nan, np.float32)
    drawn = path.with_name(f"{path.stem}-boxes.png")
    frame = Frame(path.stem, rgb, depth, np.eye(3), np.eye(4), 0.0)
    save_image(drawn, draw_detections(frame, found))
    read = detector.head.name if detector.readings.decided else "nothing certain yet"
    note(f"{len(found)} found in {path.name}, drawn in {drawn}; outputs are read as: {read}")


def run_path(arguments: argparse.Namespace) -> int:
    """Print where a network lies on disk."""
    from perception.inference.model_zoo import model_path

    write(str(model_path(arguments.name)))
    return 0
