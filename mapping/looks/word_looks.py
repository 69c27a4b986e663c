"""Things and views of a map that look like what a text says; never a fact.

The user's encoder compares where the map was made with one. Else the bundled classifier does, by
the classes of ImageNet that show what a word means.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from mapping.looks.look_store import ENCODED, LOOKS, Floats, ImageEncoder, Key, LookStore, log_p_of
from mapping.looks.user_encoder import UserEncoder, encoder_of

if TYPE_CHECKING:
    from perception.inference.encoders import LookNetwork

#: likelihood ratio from which a thing is said to look like a word: in a room of 25 things one word
#: in ten, of those that name none of them, then has a thing like it (lab/research/measurements.md)
MIN_RATIO: Final = 10.0
_RARE: Final = 0.001  # added to the background, so that no class is too rare to be a mistake
_FOLDER: Final = Path(__file__).parent
Name = TypeVar("Name", str, Key)


@dataclass(frozen=True, slots=True)
class Resemblance:
    """How much a thing looks like what a text says."""

    iri: str
    score: float  # in the units of its encoder; greater is more alike


@dataclass(frozen=True, slots=True)
class AlikeView:
    """A key view that looks like what a text says, with the pose to see it from."""

    recording: str
    frame: str
    x: float  # [m] of the camera in the map
    y: float
    heading: float  # [rad] of its optical axis, from +x towards +y
    score: float

    @property
    def key(self) -> Key:
        """Recording and frame."""
        return self.recording, self.frame


@dataclass(frozen=True, slots=True)
class Alike:
    """Things and views that look like a text, the most alike first."""

    things: tuple[Resemblance, ...]
    views: tuple[AlikeView, ...] = field(default=())
    encoder: str = ""  # name of the user's; "" for the bundled classifier


@dataclass(frozen=True, slots=True)
class ClassEncoder:
    """The bundled classifier as an encoder: a text is the classes of ImageNet that show it."""

    def scores(
        self, text: str, synset: str, things: Sequence[Floats]
    ) -> tuple[NDArray[np.float64], float] | None:
        """Likelihood ratio of each thing, rows (views, D), and the least; None without classes."""
        classes = imagenet_classes().get(synset)
        if classes is None:
            return None
        return np.array([ratio(rows, classes) for rows in things]), MIN_RATIO


@cache
def network() -> LookNetwork:
    """The bundled network, opened once; its runtime is loaded then, too."""
    from perception.inference.encoders import load_look_network

    return load_look_network()


def compares_texts(semantic_map: SemanticMap) -> bool:
    """Whether a map was made with an encoder of the user's."""
    folder = semantic_map.store.path
    return folder is not None and (folder / ENCODED).is_file()


def alike(
    semantic_map: SemanticMap, text: str, synset: str = "", *, bundled: bool = False
) -> Alike | None:
    """Things and views that look like a text; by `synset` of WordNet 3.0 if `bundled`.

    Believed objects are compared, things without a name, and with an encoder key views. None where
    it cannot be known: for a synset without classes, and a map without pictures here. Raises
    ModelError where the map's encoder is not on this machine, or does not know the text.
    """
    folder = semantic_map.store.path
    if folder is None:
        return None
    records = (*semantic_map.objects(min_existence=0.5), *semantic_map.unnamed_things())
    iris = [record.iri for record in records]
    user = None if bundled else encoder_of(folder)
    if user is None and synset not in imagenet_classes():
        return None
    encoder = ClassEncoder() if user is None else user
    rows = looks_of(semantic_map, iris, user)
    found = _likely(encoder, text, synset, rows)
    if user is None:
        return None if found is None else Alike(_as_things(found))
    from mapping.key_views.view_store import view_poses  # loads OpenCV

    poses = view_poses(folder, semantic_map.sequence, live=semantic_map.store.live)
    views = _store(semantic_map, user).of_views(poses)
    seen = _likely(user, text, synset, views)
    if found is None and seen is None:
        return None
    shown = tuple(_view(key, poses[key], score) for key, score in seen or ())
    return Alike(_as_things(found or []), shown, user.name)


def looks_of(
    semantic_map: SemanticMap, iris: Sequence[str], user: UserEncoder | None = None
) -> dict[str, Floats]:
    """Rows (views, D) of the objects that have pictures, by the user's encoder or the bundled one.

    The map must have a folder here.
    """
    return _store(semantic_map, user).of(iris)


def _store(semantic_map: SemanticMap, user: UserEncoder | None) -> LookStore:
    assert semantic_map.store.path is not None
    encoder: ImageEncoder = network() if user is None else user
    file, read_only = LOOKS if user is None else ENCODED, semantic_map.store.read_only
    return LookStore(semantic_map.store.path, encoder, file, read_only=read_only)


def _likely(
    encoder: ClassEncoder | UserEncoder, text: str, synset: str, rows: Mapping[Name, Floats]
) -> list[tuple[Name, float]] | None:
    """Names of those that are said to look like a text, with their scores, the greatest first.

    None without any rows, and for a text that the encoder has nothing for.
    """
    names = list(rows)
    found = encoder.scores(text, synset, list(rows.values())) if names else None
    if found is None:
        return None
    scores, least = found
    likely = [(n, float(s)) for n, s in zip(names, scores, strict=True) if s >= least]
    return sorted(likely, key=lambda one: (-one[1], one[0]))


def _as_things(found: Sequence[tuple[str, float]]) -> tuple[Resemblance, ...]:
    return tuple(Resemblance(iri, score) for iri, score in found)


def _view(key: Key, pose: NDArray[np.float64], score: float) -> AlikeView:
    from mapping.frames.projection import heading_of

    x, y = (float(value) for value in pose[:2, 3])
    return AlikeView(*key, x, y, heading_of(pose), score)


@cache
def imagenet_classes() -> dict[str, tuple[int, ...]]:
    """Numbers of ImageNet's classes that show a synset of WordNet 3.0, as in wallet.n.01."""
    return {
        row["synset"]: tuple(map(int, row["classes"].split()))
        for row in _rows("imagenet_words.csv")
    }


def ratio(rows: Floats, classes: Sequence[int]) -> float:
    """Probability that a thing shows one of ImageNet's `classes`, over that of things in general.

    The probability is the mean over the thing's views, `rows` (n, D) of the bundled network.
    """
    shown = np.exp(log_p_of(rows)[:, classes]).sum(axis=1).mean()
    usual = sum(_background().get(number, 0.0) for number in classes)
    return float(shown / (usual + _RARE))


@cache
def _background() -> dict[int, float]:
    """Mean probability of each class over boxes of many things in photographs; others have 0."""
    rows = _rows("imagenet_background.csv")
    return {int(row["class"]): float(row["probability"]) for row in rows}


def _rows(name: str) -> Iterator[dict[str, str]]:
    with (_FOLDER / name).open(encoding="utf-8", newline="") as file:
        yield from csv.DictReader(file)
