"""Photographs with true boxes, as COCO publishes them.

A data set is a folder with `instances.json` and `images/`, COCO's own layout
(`annotations/instances_val2017.json`, `val2017/`), or the path of the JSON file itself. See
https://cocodataset.org/#format-data; of an annotation `image_id`, `category_id`, `bbox` (x, y,
width, height [px]), `area` and `iscrowd` are read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from kg.model.regular_files import read_text

_LAYOUT = "a folder with instances.json and images/, or annotations/instances_NAME.json and NAME/"


@dataclass(frozen=True, slots=True)
class TrueBoxes:
    """Annotated boxes of one image."""

    xyxy: NDArray[np.float64]  # (n, 4) [px]
    category: NDArray[np.int64]  # (n,) ids
    area: NDArray[np.float64]  # (n,) [px^2] of the annotated thing, not of its box
    crowd: NDArray[np.bool_]  # (n,) whether it stands for several things at once


@dataclass(frozen=True, slots=True)
class CocoImage:
    """An image and what is annotated in it."""

    id: int
    path: Path
    truth: TrueBoxes


@dataclass(frozen=True, slots=True)
class CocoDataset:
    """Annotated images; iterating gives them by id."""

    path: Path  # of the JSON file
    categories: Mapping[int, str]  # id -> name, by id
    images: tuple[CocoImage, ...]

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[CocoImage]:
        return iter(self.images)


def load_coco(path: Path) -> CocoDataset:
    """Read a data set; raises ModelError for anything that is none, or has no image files."""
    file = _annotation_file(path)
    try:
        data: Any = json.loads(read_text(file))
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError(f"cannot read annotations from {file}: {error}") from error
    try:
        categories = {int(one["id"]): str(one["name"]) for one in data["categories"]}
        entries = {int(one["id"]): str(one["file_name"]) for one in data["images"]}
        truths = _truths(data["annotations"], entries, categories)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ModelError(
            f"{file} holds no COCO annotations ({type(error).__name__}: {error}); images, "
            "categories and annotations with image_id, category_id and bbox would work"
        ) from error
    if not entries:
        raise ModelError(f"{file} lists no images")
    folders = _image_folders(file)
    return CocoDataset(
        file,
        dict(sorted(categories.items())),
        tuple(
            CocoImage(number, _image_file(file, folders, name), truths[number])
            for number, name in sorted(entries.items())
        ),
    )


def _annotation_file(path: Path) -> Path:
    if path.is_file():
        return path
    found = sorted(path.glob("instances*.json")) or sorted(path.glob("annotations/instances*.json"))
    if not found:
        raise ModelError(f"no COCO data set at {path}: {_LAYOUT} would work")
    if len(found) > 1:
        names = ", ".join(str(one.relative_to(path)) for one in found)
        raise ModelError(f"{path} has several annotation files ({names}): give one of them")
    return found[0]


def _image_folders(file: Path) -> Sequence[Path]:
    base = file.parent.parent if file.parent.name == "annotations" else file.parent
    return base / "images", base / file.stem.removeprefix("instances_"), base


def _image_file(file: Path, folders: Sequence[Path], name: str) -> Path:
    parts = PurePosixPath(name)
    if parts.is_absolute() or ".." in parts.parts:
        raise ModelError(f"{file}: image {name!r} lies outside the data set")
    for path in (folder / parts for folder in folders):
        if path.is_file():
            return path
    where = ", ".join(str(folder) for folder in folders)
    raise ModelError(f"{file}: no image {name!r} in {where}")


def _truths(
    annotations: Sequence[Mapping[str, Any]],
    images: Mapping[int, str],
    categories: Mapping[int, str],
) -> dict[int, TrueBoxes]:
    rows: dict[int, list[tuple[float, ...]]] = {number: [] for number in images}
    for one in annotations:
        if one["category_id"] not in categories:
            raise ValueError(f"annotation of category {one['category_id']!r}, which is not listed")
        x, y, width, height = (float(side) for side in one["bbox"])
        area = float(one.get("area", width * height))
        row = (x, y, x + width, y + height, one["category_id"], area, bool(one.get("iscrowd")))
        if not np.isfinite(row).all() or width < 0 or height < 0:
            raise ValueError(f"box {one['bbox']!r}")
        rows[int(one["image_id"])].append(row)
    return {number: _true_boxes(found) for number, found in rows.items()}


def _true_boxes(rows: Sequence[tuple[float, ...]]) -> TrueBoxes:
    table = np.array(rows, np.float64).reshape(len(rows), 7)
    return TrueBoxes(table[:, :4], table[:, 4].astype(int), table[:, 5], table[:, 6] > 0)
