"""Things of a map that look like what a word means, by ImageNet's classes; never a fact."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from kg.maps.semantic_map import SemanticMap
from mapping.looks.object_looks import Looks, ObjectLooks

#: likelihood ratio from which a thing is said to look like a word: in a room of 25 things one word
#: in ten, of those that name none of them, then has a thing like it (lab/research/measurements.md)
MIN_RATIO: Final = 10.0
_RARE: Final = 0.001  # added to the background, so that no class is too rare to be a mistake
_FOLDER: Final = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Resemblance:
    """How much a thing looks like what a word means."""

    iri: str
    ratio: float  # how many times more than things in general


@cache
def imagenet_classes() -> dict[str, tuple[int, ...]]:
    """Numbers of ImageNet's classes that show a synset of WordNet 3.0, as in wallet.n.01."""
    return {
        row["synset"]: tuple(map(int, row["classes"].split()))
        for row in _rows("imagenet_words.csv")
    }


def things_that_look_like(semantic_map: SemanticMap, synset: str) -> tuple[Resemblance, ...] | None:
    """Things of a map that look like `synset`, most first; empty where nothing does.

    Believed objects are compared, and things without a name. None where it cannot be known: for a
    synset without classes of ImageNet, and a map without pictures here.
    """
    folder = semantic_map.store.path
    classes = imagenet_classes().get(synset)
    if folder is None or classes is None:
        return None
    records = (*semantic_map.objects(min_existence=0.5), *semantic_map.unnamed_things())
    looks = ObjectLooks(folder, read_only=semantic_map.store.read_only)
    seen = looks.of([record.iri for record in records])
    if not seen:
        return None
    found = (Resemblance(iri, ratio(look, classes)) for iri, look in seen.items())
    likely = [one for one in found if one.ratio >= MIN_RATIO]
    return tuple(sorted(likely, key=lambda one: (-one.ratio, one.iri)))


def ratio(looks: Looks, classes: Sequence[int]) -> float:
    """Probability that a thing shows one of ImageNet's `classes`, over that of things in general.

    The probability is the mean over the thing's views.
    """
    shown = np.exp(looks.log_p[:, classes]).sum(axis=1).mean()
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
