"""The labels of a network's classes: from its metadata, from a list beside it, or by convention."""

from __future__ import annotations

import ast
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from kg.model.errors import ModelError
from kg.model.regular_files import read_text
from perception.inference.model_zoo import NETWORKS, ModelCard

NO_OBJECT = "n/a"
COCO_IDS = 91  # classes of networks that answer COCO's published ids
UNUSED_IDS = (0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83)  # of COCO's 1 to 90
METADATA_KEYS = ("names", "labels", "classes", "class_names")


def read_labels(path: Path) -> tuple[str, ...]:
    """Labels of a file, one a line.

    Lines may be as in the published Places365 list, `/k/kitchen 203`: folder letter and index go.
    """
    try:
        lines = [line.strip() for line in read_text(path).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"cannot read labels {path}: {error}") from error
    return tuple(_plain(line) for line in lines if line)


def _plain(line: str) -> str:
    if len(line) > 3 and line[0] == "/" and line[2] == "/":
        return line[3:].rsplit(" ", 1)[0]
    return line


def labels_for(
    model: Path,
    classes: int | None,
    *,
    given: Sequence[str] | Path | None = None,
    metadata: Mapping[str, str] | None = None,
    card: ModelCard | None = None,
) -> tuple[str, ...]:
    """Labels of the network in file `model` with `classes` classes (None = it does not say).

    In this order: `given`; the network's own metadata; STEM.labels.txt beside it; the card's list;
    a labels_*.txt beside it with as many lines as classes; COCO's 80 labels for 80 or unknown
    classes. Raises ModelError where the list found does not have `classes` labels.
    """
    found, source = _explicit(model, given, metadata or {}, card)
    if found is None:
        found, source = _by_count(model, classes)
    if found is None:
        raise ModelError(
            f"{model.name} has {classes} classes and no labels: put {model.stem}.labels.txt "
            "with one label a line beside it"
        )
    if classes is not None and len(found) != classes:
        raise ModelError(f"{model.name} has {classes} classes, {source} {len(found)} labels")
    return found


_Found = tuple[tuple[str, ...] | None, str]


def _explicit(
    model: Path,
    given: Sequence[str] | Path | None,
    metadata: Mapping[str, str],
    card: ModelCard | None,
) -> _Found:
    if isinstance(given, Path):
        return read_labels(given), str(given)
    if given is not None:
        return tuple(given), "the given list has"
    for key in METADATA_KEYS:
        if key in metadata:
            return _from_metadata(metadata[key]), f"its metadata {key!r} has"
    beside = model.with_suffix(".labels.txt")
    if beside.is_file():
        return read_labels(beside), f"{beside.name} has"
    if card is not None and card.labels is not None:
        shipped = NETWORKS / f"labels_{card.labels}.txt"
        return read_labels(shipped), f"{shipped.name} has"
    return None, ""


def _by_count(model: Path, classes: int | None) -> _Found:
    for path in sorted(model.parent.glob("labels_*.txt")):
        found = read_labels(path)
        if len(found) == classes:
            return found, path.name
    if classes in (80, None):
        return read_labels(NETWORKS / "labels_coco80.txt"), "COCO has"
    if classes == COCO_IDS:
        return coco_by_id(), "COCO has"
    return None, ""


def coco_by_id() -> tuple[str, ...]:
    """COCO's 80 labels at their published ids, 1 to 90; the others are NO_OBJECT."""
    labels = iter(read_labels(NETWORKS / "labels_coco80.txt"))
    return tuple(NO_OBJECT if i in UNUSED_IDS else next(labels) for i in range(COCO_IDS))


def is_object(label: str) -> bool:
    """Whether the label names a kind of object; lists of labels also name "no object"."""
    return label.strip("_ ").lower() not in (NO_OBJECT, "", "background", "no object")


def _from_metadata(text: str) -> tuple[str, ...]:
    """Labels as exporters write them: a JSON or Python list or dictionary, or separated text."""
    for parse in (json.loads, ast.literal_eval):
        try:
            value = parse(text)
        except (ValueError, SyntaxError):
            continue
        if isinstance(value, dict):
            return tuple(str(label) for _, label in sorted((int(k), v) for k, v in value.items()))
        if isinstance(value, list):
            return tuple(str(label) for label in value)
    separator = "\n" if "\n" in text.strip() else ","
    return tuple(label.strip() for label in text.strip().split(separator))
