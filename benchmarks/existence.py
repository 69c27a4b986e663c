"""Existence: fits the evidence of `mapping.objects.existence` to rooms whose objects are known.

    python -m benchmarks.existence [--cache DIR]

Maps what `benchmarks.rooms` maps: real rooms in stretches with every network, and simulated houses
with the demo's senses and hard ones, by a mapper that keeps its candidates. A track is true where
it matches a true object, one to one and the surest first, and counts neither way where it matches
an ignored entry. Its evidence is fitted by logistic regression, with equal weight on each room and
on the houses together. Prints Markdown: each group by the shipped numbers and by those fitted
without it (a / b), AP and log loss of other evidence fitted likewise, and the numbers of all.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.rooms.houses import HOUSES, toured
from benchmarks.rooms.measuring import each, parts
from benchmarks.rooms.recordings import detector_of, look, looks, networks, room_folders
from hereabouts.cli.arguments import count, whole
from kg.serving.opening import in_memory_map
from lab.command_line import run
from lab.maps.truth_matching import MappedObject, TruthMatcher
from lab.networks.calibration import reliability
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.existence import MISSED, NOTHING, SEEN, SIZE, logit, size_log_likelihood
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track
from perception.frames import Frame
from perception.inference.recorded_detections import RecordedDetector

SEEDS: Final = (701, 702, 703, 704)  # of the houses
_RIDGE: Final = 1e-3
_STEPS: Final = 40

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrackEvidence:
    """Final evidence for one track, and whether a thing of its category is there."""

    group: str  # room, or HOUSES
    run: str  # of the mapper; single frames of a room and network are one
    true: bool
    strength: float  # S, of the hits
    missed: float  # M, of the misses
    size: float  # log-likelihood
    frames: int = 0  # that show it
    viewpoints: int = 0  # with views of it
    others: float = 0.0  # S of its other categories
    best: float = 0.5  # best score


Tracks = Sequence[TrackEvidence]
Weighed = Callable[[TrackEvidence], tuple[float, ...]]  # the weighed evidence of a track


def shipped(t: TrackEvidence) -> tuple[float, ...]:
    """Weighed evidence of the shipped parameters."""
    return math.log1p(t.strength), *_rest(t)


def _rest(t: TrackEvidence) -> tuple[float, ...]:
    return -math.log1p(t.missed), t.size


TRIED: Final[dict[str, Weighed]] = {
    "S, misses, size": shipped,
    "frames": lambda t: (math.log1p(t.frames),),
    "S": lambda t: (math.log1p(t.strength),),
    "frames, misses, size": lambda t: (math.log1p(t.frames), *_rest(t)),
    "viewpoints, misses, size": lambda t: (math.log1p(t.viewpoints), *_rest(t)),
    "S, misses, size, frames": lambda t: (*shipped(t), math.log1p(t.frames)),
    "S, misses, size, viewpoints": lambda t: (*shipped(t), math.log1p(t.viewpoints)),
    "S, misses, size, best score": lambda t: (*shipped(t), logit(t.best)),
    "S, misses, size, other categories": lambda t: (*shipped(t), math.log1p(t.others)),
}
SHIPPED: Final = np.array([SEEN, MISSED, SIZE, -NOTHING])


class KeepingMapper(BayesObjectMapper):
    """Keeps all that it ever took for a thing."""

    def _improbable(self, track: Track) -> bool:
        return False

    def _drop(self, lost: Sequence[Track]) -> None:
        pass

    def evidence(self, group: str, run: str, matcher: TruthMatcher) -> Iterator[TrackEvidence]:
        """Evidence of all tracks but those that match ignored entries."""
        tracks = sorted(self.tracks, key=lambda t: -t.log_odds[t.category])
        label, usual = self._map.catalogue.label, self._updater.usual_size
        objects = [MappedObject(label(t.category), t.position) for t in tracks]
        for t, true in zip(tracks, truths(objects, matcher), strict=True):
            held = t.evidence[t.category]
            side = float(np.median(t.sizes)) if t.sizes else 0.0
            if true is not None:
                yield TrackEvidence(
                    group=group,
                    run=run,
                    true=true,
                    strength=held.strength,
                    missed=max(t.looks - held.looks, 0.0),
                    size=size_log_likelihood(side, usual(t.category)),
                    frames=t.observations,
                    viewpoints=len(t.viewpoints),
                    others=sum(e.strength for e in t.evidence.values()) - held.strength,
                    best=t.best.score if t.best else 0.5,
                )


def truths(objects: Sequence[MappedObject], matcher: TruthMatcher) -> list[bool | None]:
    """Whether each of `objects`, the surest first, is a true one; None where it is ignored."""
    found, taken = list[bool | None](), set[int]()
    for one in objects:
        near = [i for i in range(len(matcher.truth)) if matcher.matches(one, i)]
        free = [i for i in near if not matcher.truth[i].ignore and i not in taken]
        if free:
            taken.add(min(free, key=lambda i: matcher.distance(one, i)))
        ignored = any(matcher.truth[i].ignore for i in near)
        found.append(True if free else None if ignored else False)
    return found


def mapped(
    group: str,
    run: str,
    frames: Sequence[Frame],
    seen: Sequence[RecordedDetector],
    matcher: TruthMatcher,
) -> list[TrackEvidence]:
    """Evidence of all tracks, by what networks saw in `frames`."""
    detector = detector_of(seen, ObjectSettings().min_score)
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        mapper = KeepingMapper(semantic_map, model=detector.name)
        for frame in frames:
            mapper.add(frame, detector.detect(frame))
        return [*mapper.evidence(group, run, matcher)]


def room_evidence(
    folder: Path, network: str, looking: Sequence[str], cache: Path
) -> list[TrackEvidence]:
    """Evidence of all tracks in all stretches of the recording in `folder`."""
    seen = looks(folder, looking, cache)
    return [
        one
        for stretch, frames, matcher in parts(folder)
        for one in mapped(folder.name, f"{network}, {stretch}", frames, seen, matcher)
    ]


def house_evidence(seed: int) -> list[TrackEvidence]:
    """Evidence of all tracks in the house of `seed`: the whole tour, and every 4th frame of it."""
    tour = toured(seed)
    return [
        one
        for senses, seen in tour.seen.items()
        for step in (1, 4)
        for one in mapped(
            HOUSES, f"{seed}, {senses}, {step}", tour.frames[::step], (seen,), tour.truth
        )
    ]


def fit(features: Vector, true: Vector, weights: Vector) -> Vector:
    """Weights (k + 1,) of features (n, k) and of 1, by logistic regression.

    Iteratively reweighted least squares, with a small ridge penalty on all but the last; `true`
    (n,) is 0 or 1, `weights` (n,) are the cases'.
    """
    design = np.column_stack([features, np.ones(len(features))])
    penalty = _RIDGE * np.diag([*np.ones(features.shape[1]), 0.0])
    found = np.zeros(design.shape[1])
    for _ in range(_STEPS):
        p = probability(features, found)
        hessian = design.T @ (design * (weights * p * (1 - p))[:, None]) + penalty
        found += np.linalg.solve(hessian, design.T @ (weights * (true - p)) - penalty @ found)
    return found


def probability(features: Vector, numbers: Vector) -> Vector:
    """(n,) probabilities by features (n, k) and `numbers` (k + 1,)."""
    odds = features @ numbers[:-1] + numbers[-1]
    return np.asarray(1 / (1 + np.exp(-np.clip(odds, -30, 30))))


def average_precision(p: Vector, true: NDArray[np.bool_]) -> float:
    """Mean precision at the true cases of (n,), as the least probability falls."""
    above = p >= np.unique(p)[::-1, None]
    hits = (above & true).sum(axis=1)
    return float(np.diff(hits, prepend=0) @ (hits / above.sum(axis=1)) / hits[-1])


def fitted(tracks: Tracks, weighed: Weighed) -> Vector:
    """Numbers fitted on `tracks`, each group of equal weight."""
    sizes = Counter(t.group for t in tracks)
    weights = np.array([len(tracks) / len(sizes) / sizes[t.group] for t in tracks])
    features = np.array([weighed(t) for t in tracks])
    return fit(features, np.array([float(t.true) for t in tracks]), weights)


def scores(tracks: Tracks, weighed: Weighed, numbers: Vector) -> tuple[float, float, float]:
    """Log loss, ECE and mean average precision over the runs of `tracks`, by `numbers`."""
    true, runs = np.array([t.true for t in tracks]), np.array([t.run for t in tracks])
    p = probability(np.array([weighed(t) for t in tracks]), numbers)
    loss = -float(np.log(np.where(true, p, 1 - p)).mean())
    error = reliability(zip(p.tolist(), true.tolist(), strict=True)).ece or 0.0
    judged = [of for of in (runs == run for run in np.unique(runs)) if 0 < true[of].mean() < 1]
    precisions = [average_precision(p[of], true[of]) for of in judged]
    return loss, error, float(np.mean(precisions)) if precisions else math.nan


def report(tracks: Tracks) -> Iterator[str]:
    """Markdown: each group by the shipped numbers and by others'; what was tried; the numbers."""
    groups = [*dict.fromkeys(t.group for t in tracks)]
    apart = [
        ([t for t in tracks if t.group == group], [t for t in tracks if t.group != group])
        for group in groups
    ]
    yield "| group | tracks | true | log loss | ECE | AP | numbers without it |"
    yield "|---|---|---|---|---|---|---|"
    for group, (own, others) in zip(groups, apart, strict=True):
        numbers = fitted(others, shipped)
        pairs = zip(scores(own, shipped, SHIPPED), scores(own, shipped, numbers), strict=True)
        cells = [f"{a:.3f} / {b:.3f}" for a, b in pairs]
        counts = map(str, (len(own), sum(t.true for t in own)))
        yield f"| {' | '.join([group, *counts, *cells, _numbers(numbers)])} |"
    yield f"\n| weighed | {' | '.join(groups)} | numbers on all |"
    yield "|" + "---|" * (len(groups) + 2)
    for name, weighed in TRIED.items():
        left_out = [scores(own, weighed, fitted(others, weighed)) for own, others in apart]
        cells = [f"{precision:.3f} / {loss:.3f}" for loss, _, precision in left_out]
        yield f"| {' | '.join([name, *cells, _numbers(fitted(tracks, weighed))])} |"
    seen, missed, size, nothing = fitted(tracks, shipped)
    yield f"\nSEEN {seen:.2f}, MISSED {missed:.2f}, SIZE {size:.2f}, NOTHING {-nothing:.2f}"


def _numbers(numbers: Vector) -> str:
    return ", ".join(f"{number:.2f}" for number in numbers)


def _command(arguments: argparse.Namespace) -> int:
    folders, every, processes = [*room_folders().values()], networks(), arguments.processes
    if len(folders) + bool(arguments.seeds) < 2:
        arguments.usage_error("each group is judged by the others: two rooms or houses would work")
    with tempfile.TemporaryDirectory() as temporary:
        cache = arguments.cache or Path(temporary)
        cache.mkdir(parents=True, exist_ok=True)
        names = [one for looking in every.values() for one in looking]
        each(look, [(folder, names, cache) for folder in folders], processes)
        rooms = [(folder, *network, cache) for folder in folders for network in every.items()]
        tracks = [*chain.from_iterable(each(room_evidence, rooms, processes))]
    houses = [(seed,) for seed in arguments.seeds]
    tracks += chain.from_iterable(each(house_evidence, houses, processes))
    sys.stdout.write("\n".join(report(tracks)) + "\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Map, fit, and print the tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.existence", description=__doc__)
    parser.add_argument("--seeds", type=count, nargs="*", default=SEEDS, help="houses")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keeps what networks saw")
    parser.add_argument("--processes", type=whole, default=os.cpu_count() or 1)
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())
