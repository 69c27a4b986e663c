"""List, download, check and locate networks.

Two networks come with hereabouts; others can be downloaded.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import add_command, declare
from hereabouts.cli.console import (
    note,
    print_answer,
    print_table,
    printable,
    progress,
    write,
    write_json,
)
from kg.model.shares import percent

if TYPE_CHECKING:
    from mapping.looks.user_encoder import UserEncoder
    from perception.inference.detector import OnnxDetector
    from perception.inference.model_zoo import ModelCard


_CHECK = """
[FILE]             a detector (.onnx, or a name), or a list of labels (.txt); with --encoder a map
[IMAGE]            a photograph, to draw what the detector finds
--labels FILE      labels of the detector, one a line
--head NAME        meaning of its outputs, where an error names two
--encoder FILES    check image.onnx,text.onnx instead; with a map as FILE tell how many absent words
                   nothing in it is said to look like
--negatives WORDS  words of things that are absent, to which the encoder's threshold is fitted: a
                   file with one a line, or zebra,glacier,... (default: 160 animals, vehicles and
                   landscapes)
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for name, run, options in (
        ("list", run_list, "--json"),
        ("fetch", run_fetch, "NAME  a name of `models list`, or best for the best detector"),
        ("check", run_check, _CHECK),
        ("path", run_path, "NAME  a name of `models list`"),
    ):
        declare(add_command(actions, name, run.__doc__ or "", run=run), options)


def run_list(arguments: argparse.Namespace) -> int:
    """All known networks, with licence and quality."""
    from perception.inference.model_zoo import extension_cards, known_models

    models = (*known_models(), *extension_cards())
    rows = [
        (m.name, m.kind, m.where, f"{m.size / 1e6:.1f}" if m.size else "-", m.licence, m.quality)
        for m in models
    ]
    columns = ("name", "kind", "here", "MB", "licence", "quality")
    print_answer(columns, rows, arguments.json, [model.to_json() for model in models])
    return 0


def run_fetch(arguments: argparse.Namespace) -> int:
    """Download a network, resuming and checking it."""
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
    """List what a detector can see, and what it cannot."""
    if arguments.encoder is not None:
        return run_check_encoder(arguments)
    if arguments.negatives is not None:
        arguments.usage_error("--negatives is for an encoder: --encoder image.onnx,text.onnx")
    if arguments.file is None:
        arguments.usage_error("give a detector or a list of labels, or --encoder FILES")
    from kg.knowledge.ontology.catalogue import shipped_ontology
    from mapping.labels.label_resolver import check_labels
    from perception.inference.class_labels import is_object, read_labels
    from perception.inference.detector import load_detector

    if arguments.file.endswith(".txt"):
        if arguments.image or arguments.head or arguments.labels:
            arguments.usage_error("IMAGE, --head and --labels are for a detector, not for a list")
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


def run_check_encoder(arguments: argparse.Namespace) -> int:
    """Check an encoder, fit its threshold to absent words, and judge it by the map in `file`."""
    from mapping.looks.user_encoder import given_words, remembered

    if arguments.image or arguments.head or arguments.labels:
        arguments.usage_error("IMAGE, --head and --labels are for a detector, not for an encoder")
    words = None if arguments.negatives is None else given_words(arguments.negatives)
    encoder = remembered(arguments.encoder, words)
    found = None if arguments.file is None else _refused(arguments.file, encoder)
    note(f"{encoder.name}: {encoder.size} values, {len(encoder.words)} absent words")
    if found is not None:
        share, things = found
        of_words = f"{percent(share)} of words, fitted to the others"
        note(f"nothing of {things} things looks like {of_words}")
    if arguments.json:
        answer = {"encoder": encoder.name, "checksum": encoder.checksum, "values": encoder.size}
        judged = {} if found is None else {"nothing_looks_like": found[0], "things": found[1]}
        write_json({**answer, "absent_words": len(encoder.words), **judged})
    return 0


def _refused(address: str, encoder: UserEncoder) -> tuple[float, int]:
    """Share of absent words that nothing in a map looks like, and the number of its things."""
    from kg.model.errors import ModelError
    from kg.serving.opening import open_map
    from mapping.looks.user_encoder import check_same, share_refused
    from mapping.looks.word_looks import looks_of

    with open_map(address, read_only=True) as semantic_map:
        if semantic_map.store.path is None:
            raise ModelError(f"{address} is no folder of a map, where pictures of things are")
        check_same(semantic_map.store.path, encoder)
        records = (*semantic_map.objects(min_existence=0.5), *semantic_map.unnamed_things())
        rows = looks_of(semantic_map, [record.iri for record in records], encoder)
    if not rows:
        raise ModelError(f"{address} has no pictures of things to compare words with")
    return share_refused(list(rows.values()), encoder), len(rows)


def run_path(arguments: argparse.Namespace) -> int:
    """Print the path of a network's file."""
    from perception.inference.model_zoo import model_path

    write(str(model_path(arguments.name)))
    return 0
