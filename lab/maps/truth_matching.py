"""Matching of a map's objects to a complete truth, or to the truth of some classes.

1. matched: an accepted label within reach of a true object, one to one, nearest pair first;
2. of the rest: the same against ignored entries counts neither way;
3. of the rest: an accepted label near a matched true object is a duplicate; near an ignored one
   that is taken it counts neither way;
4. of the rest: within reach of any entry, whatever its class, is a wrong label, else a ghost.

Reach is `near` (0.5 m; large things 1.0 m) unless the entry has its own.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from lab.maps.complete_truth import TrueObject
from mapping.frames.projection import to_map
from mapping.reference.class_scores import Truth

LARGE: Final = ("bed", "couch", "dining table")
FAR: Final = 1.0  # [m] reach of large things
NEAR: Final = 0.5  # [m] reach of all others
_MARGIN: Final = 0.3  # [m] beyond half the extent of a large thing, for duplicates
_NOT_CENTRED: Final = "dining table"  # its extent holds the chairs around it


@dataclass(frozen=True, slots=True, eq=False)
class MappedObject:
    """An object of the map under evaluation."""

    label: str
    p_map: NDArray[np.float64]  # (3,) [m]
    existence: float = 1.0  # 0..1
    iri: str = ""
    covariance: NDArray[np.float64] | None = None  # (3, 3) [m^2] of p_map, in the map frame


@dataclass(frozen=True, slots=True)
class Pair:
    """A mapped object and the entry of the truth it is compared to."""

    mapped: int
    true: int  # -1: the truth has no entry
    distance: float  # [m]


@dataclass(frozen=True, slots=True)
class Matching:
    """Every mapped object in one of five groups; pairs outside `matched` name the nearest entry."""

    mapped: tuple[MappedObject, ...]
    matched: tuple[Pair, ...]
    duplicates: tuple[Pair, ...]
    wrong: tuple[Pair, ...]  # labels
    ghosts: tuple[Pair, ...]
    ignored: tuple[Pair, ...]
    missed: tuple[int, ...]  # true objects that nothing matches


class TruthMatcher:
    """A complete truth in the map frame, to match objects of maps to.

    Args:
        truth: the entries.
        T_map_world: (4, 4) takes the truth's positions to the map frame.
        near: [m] reach of things that are not large.
    """

    def __init__(
        self,
        truth: Sequence[TrueObject],
        T_map_world: NDArray[np.float64],
        near: float = NEAR,
    ) -> None:
        self.truth = tuple(truth)
        self.T_map_world = T_map_world
        self.p_map = to_map(T_map_world, np.array([t.p_world for t in truth]).reshape(-1, 3))
        self.near = near

    @property
    def counted(self) -> int:
        """The number of true objects that count: all that are not ignored."""
        return sum(not t.ignore for t in self.truth)

    def match(self, mapped: Iterable[MappedObject]) -> Matching:
        """Each object's group, by the rules of this module."""
        objects = tuple(mapped)
        matched = self.pairs(objects, range(len(objects)))
        left = set(range(len(objects))) - {pair.mapped for pair in matched}
        ignored = self.pairs(objects, sorted(left), ignored=True)
        left -= {pair.mapped for pair in ignored}
        found = {pair.true for pair in matched}
        groups: dict[str, list[Pair]] = {"duplicate": [], "wrong": [], "ghost": []}
        groups["ignored"] = ignored
        for m in sorted(left):
            nearest = self._nearest(objects[m], m)
            groups[self._group(objects[m], found, nearest.distance)].append(nearest)
        return Matching(
            mapped=objects,
            matched=tuple(matched),
            duplicates=tuple(groups["duplicate"]),
            wrong=tuple(groups["wrong"]),
            ghosts=tuple(groups["ghost"]),
            ignored=tuple(ignored),
            missed=tuple(i for i, t in enumerate(self.truth) if not t.ignore and i not in found),
        )

    def pairs(
        self,
        mapped: Sequence[MappedObject],
        among: Iterable[int],
        *,
        ignored: bool = False,
        taken: Iterable[int] = (),
    ) -> list[Pair]:
        """One-to-one pairs of accepted labels within reach, nearest first (rules 1 and 2).

        `among` are indices into `mapped`; entries `taken` are left out.
        """
        order = sorted(
            (self.distance(mapped[m], i), m, t.name, i)
            for m in among
            for i, t in enumerate(self.truth)
            if t.ignore == ignored and t.accepts(mapped[m].label)
        )
        used_m, used_t, pairs = set[int](), set(taken), list[Pair]()
        for distance, m, _, i in order:
            within = distance <= self._reach(self.truth[i], mapped[m].label)
            if within and m not in used_m and i not in used_t:
                used_m.add(m)
                used_t.add(i)
                pairs.append(Pair(m, i, distance))
        return pairs

    def matches(self, o: MappedObject, i: int) -> bool:
        """Whether `o` may be matched to entry `i`: an accepted label within reach."""
        t = self.truth[i]
        return t.accepts(o.label) and self.distance(o, i) <= self._reach(t, o.label)

    def distance(self, o: MappedObject, i: int) -> float:
        """Distance [m] between `o` and entry `i`."""
        return float(np.linalg.norm(o.p_map - self.p_map[i]))

    def _reach(self, t: TrueObject, label: str) -> float:
        return t.reach or (FAR if t.label in LARGE or label in LARGE else self.near)

    def _nearest(self, o: MappedObject, index: int) -> Pair:
        near = ((self.distance(o, i), t.name, i) for i, t in enumerate(self.truth))
        distance, _, true = min(near, default=(float("inf"), "", -1))
        return Pair(index, true, distance)

    def _group(self, o: MappedObject, found: set[int], nearest: float) -> str:
        if any(self._doubles(o, i) for i in found):
            return "duplicate"
        if any(t.ignore and self._doubles(o, i) for i, t in enumerate(self.truth)):
            return "ignored"
        reach = FAR if o.label in LARGE else self.near
        inside = any(self._inside(o, i) for i in range(len(self.truth)))
        return "wrong" if nearest <= reach or inside else "ghost"

    def _doubles(self, o: MappedObject, i: int) -> bool:
        """Whether `o` may be another record of true object `i`."""
        t = self.truth[i]
        reach = self._reach(t, o.label)
        if t.label in LARGE and t.extent:
            reach = max(reach, max(t.extent[:2]) / 2 + _MARGIN)
        return t.accepts(o.label) and self.distance(o, i) <= reach

    def _inside(self, o: MappedObject, i: int) -> bool:
        t = self.truth[i]
        extended = bool(t.extent) and t.label != _NOT_CENTRED
        return extended and self.distance(o, i) <= max(t.extent) / 2


def load_truth(path: Path) -> Truth:
    """Read {"objects": {NAME: {"cls", "position"}}, "complete_for": [...]}.

    Raises RecordingError, naming file and entry, where that is not what is there.
    """
    try:
        data: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"cannot read truth from {path}: {error}") from error
    try:
        objects = data["objects"]
        positions = [entry["position"] for entry in objects.values()]
        p_world = np.array(positions, dtype=np.float64).reshape(len(positions), 3)
        labels = tuple(str(entry["cls"]) for entry in objects.values())
        complete = data.get("complete_for", [])
        if not isinstance(complete, list):
            raise TypeError(f"complete_for must be a list of labels, not {complete!r}")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(
            f'{path} is no truth ({error!r}); {{"objects": {{NAME: {{"cls": LABEL, '
            '"position": [x, y, z]}}} would work'
        ) from error
    if not np.all(np.isfinite(p_world)):
        raise RecordingError(f"{path} holds a position that is not finite")
    return Truth(tuple(objects), labels, p_world, tuple(map(str, complete)))
