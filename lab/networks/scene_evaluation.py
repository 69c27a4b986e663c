"""Evaluation of a scene classifier on photographs in folders that are called by their class."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from kg.model.errors import ModelError
from lab.networks.calibration import Calibration, reliability
from perception.inference.scene_classifier import OnnxSceneClassifier
from perception.sources.folders.image_files import COLOUR_SUFFIXES, read_colour

TOP: Final = 5


@dataclass(frozen=True, slots=True)
class SceneEvaluation:
    """Scores of a scene classifier on images of the classes that it knows."""

    classifier: str
    images: int
    top1: float  # share whose class has the highest probability
    top5: float  # ... one of the five highest
    calibration: Calibration  # of the highest probability
    confusion: Mapping[str, Mapping[str, int]]  # true class -> answered class -> images
    unknown: Mapping[str, int]  # folders of classes that it does not have -> images, not counted

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        return asdict(self)


def labelled_images(folder: Path) -> Iterator[tuple[str, Path]]:
    """(class, image) of the images in the folders of `folder`, in order."""
    if not folder.is_dir():
        raise ModelError(f"no folder {folder}: one with a folder of images for each class would do")
    for inner in sorted(path for path in folder.iterdir() if path.is_dir()):
        for path in sorted(inner.iterdir()):
            if path.suffix.lower() in COLOUR_SUFFIXES:
                yield inner.name, path


def evaluate_scenes(
    classifier: OnnxSceneClassifier,
    folder: Path,
    *,
    on_image: Callable[[int], None] | None = None,
) -> SceneEvaluation:
    """Scores of `classifier` on the images under `folder`; each folder is called by its class.

    `on_image` gets the number of images done. Raises ModelError where there is no image of a class
    that the network knows, RecordingError for an unreadable one.
    """
    known = {_plain(label): label for label in classifier.labels}
    confusion: dict[str, dict[str, int]] = {}
    unknown: dict[str, int] = {}
    outcomes: list[tuple[float, bool]] = []
    among = 0
    for number, (name, path) in enumerate(labelled_images(folder), start=1):
        wanted = known.get(_plain(name))
        if wanted is None:
            unknown[name] = unknown.get(name, 0) + 1
        else:
            probability = classifier.classify_image(read_colour(path)).probability
            best = sorted(probability, key=probability.__getitem__, reverse=True)[:TOP]
            outcomes.append((probability[best[0]], best[0] == wanted))
            among += wanted in best
            row = confusion.setdefault(wanted, {})
            row[best[0]] = row.get(best[0], 0) + 1
        if on_image is not None:
            on_image(number)
    if not outcomes:
        raise ModelError(
            f"no images of a class of {classifier.name} in {folder}: a folder for each class, "
            f"such as {', '.join(classifier.labels[:3])}, with .jpg or .png images would do"
        )
    return SceneEvaluation(
        classifier.name,
        len(outcomes),
        sum(right for _, right in outcomes) / len(outcomes),
        among / len(outcomes),
        reliability(outcomes),
        confusion,
        unknown,
    )


def _plain(name: str) -> str:
    """A class by whatever writing: "living_room", "Living room"."""
    return name.replace("_", " ").replace("-", " ").replace("/", " ").lower().strip()
