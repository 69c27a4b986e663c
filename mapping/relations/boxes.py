"""Boxes of objects as arrays, for the geometry of relations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kg.model.oriented_boxes import along, upright_bounds
from kg.model.records import ObjectRecord

Floats = NDArray[np.float64]
SHOWN = 0.5  # existence from which on an object takes part in relations


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An object's box: two corners along the map's axes, turned by `yaw` about their middle."""

    low: Floats  # (3,) [m]
    high: Floats  # (3,) [m]
    deviation: float  # [m] standard deviation of each coordinate of its position
    category: str  # IRI
    length: float = 0.02  # [m] longest side, or the usual one of its category where that is more
    yaw: float = 0.0  # [rad]

    @property
    def sides(self) -> tuple[Floats, Floats]:
        """Corners (3,) [m] along the map's axes of the box that holds it."""
        half = upright_bounds(self.high - self.low, self.yaw) / 2
        middle = (self.low + self.high) / 2
        return middle - half, middle + half

    def differs(self, other: Box | None, by: float) -> bool:
        """Whether any side lies more than `by` [m] elsewhere, or the category is another."""
        return (
            other is None
            or self.category != other.category
            or bool(np.abs(self.low - other.low).max() > by)
            or bool(np.abs(self.high - other.high).max() > by)
            or abs(self.yaw - other.yaw) * float((self.high - self.low)[:2].max()) > 2 * by
        )


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """n boxes, each turned by its yaw about its middle."""

    low: Floats  # (n, 3) [m]
    high: Floats  # (n, 3) [m]
    deviation: Floats  # (n,) [m]
    length: Floats  # (n,) [m] longest sides, or usual ones where these are more
    yaw: Floats  # (n,) [rad]

    @classmethod
    def of(cls, boxes: Sequence[Box]) -> Boxes:
        """The arrays of `boxes`."""
        return cls(
            np.array([box.low for box in boxes]).reshape(-1, 3),
            np.array([box.high for box in boxes]).reshape(-1, 3),
            np.array([box.deviation for box in boxes], np.float64),
            np.array([box.length for box in boxes], np.float64),
            np.array([box.yaw for box in boxes], np.float64),
        )

    @property
    def middle(self) -> Floats:
        """(n, 3) [m]."""
        return (self.low + self.high) / 2

    def seen_from(self, others: Boxes) -> Floats:
        """(n, m, 2) [m] middles of these n boxes from above, in the axes of m others."""
        return along(self.middle[:, None] - others.middle[None], others.yaw)[..., :2]

    def reach_along(self, others: Boxes) -> Floats:
        """(n, m, 2) [m] half lengths of these n boxes along the axes of m others."""
        half = (self.high - self.low)[:, None] / 2
        return upright_bounds(half, self.yaw[:, None] - others.yaw)[..., :2]

    @property
    def longest(self) -> Floats:
        """(n,) [m] longest side of each, at least 2 cm."""
        return np.asarray(np.maximum((self.high - self.low).max(axis=1), 0.02))


class BoxIndex:
    """Index of boxes by IRI, with a search for near ones."""

    def __init__(self) -> None:
        self._boxes: dict[str, Box] = {}
        self._rows: dict[str, int] = {}
        self._iris: list[str] = []  # by row
        self._sides = np.full((64, 6), np.nan)  # [m] low and high corners by row

    def __contains__(self, iri: str) -> bool:
        return iri in self._boxes

    def __getitem__(self, iri: str) -> Box:
        return self._boxes[iri]

    def get(self, iri: str) -> Box | None:
        """Box of an object; None where it has none."""
        return self._boxes.get(iri)

    def put(self, iri: str, box: Box | None) -> None:
        """Set or, with None, remove the box of an object."""
        if box is None:
            if self._boxes.pop(iri, None) is not None:
                row = self._rows.pop(iri)
                last = self._iris.pop()
                if last != iri:  # the last one takes its row
                    self._iris[row], self._rows[last] = last, row
                    self._sides[row] = self._sides[len(self._iris)]
            return
        if iri not in self._rows:
            self._rows[iri] = len(self._iris)
            self._iris.append(iri)
            if len(self._iris) > len(self._sides):
                self._sides = np.concatenate([self._sides, np.full_like(self._sides, np.nan)])
        self._boxes[iri] = box
        self._sides[self._rows[iri]] = np.concatenate(box.sides)

    def within(self, boxes: Sequence[Box], reach: float) -> dict[str, None]:
        """IRIs of the boxes within `reach` [m] of the hull of `boxes`, as an ordered set."""
        low = np.min([box.sides[0] for box in boxes], axis=0) - reach
        high = np.max([box.sides[1] for box in boxes], axis=0) + reach
        sides = self._sides[: len(self._iris)]
        near = (sides[:, :3] <= high).all(axis=1) & (sides[:, 3:] >= low).all(axis=1)
        return {self._iris[row]: None for row in np.nonzero(near)[0].tolist()}


def box_of(record: ObjectRecord, usual: float) -> Box | None:
    """Box of an object that is believed to be there; None without an extent.

    `usual` [m] is the length that things of its category usually have.
    """
    if record.existence < SHOWN or record.extent is None:
        return None
    deviation = record.deviation or 0.0
    if not np.isfinite([*record.p_map, *record.extent, deviation, record.yaw]).all():
        return None  # written by an update from outside
    half = record.extent / 2
    return Box(
        low=record.p_map - half,
        high=record.p_map + half,
        deviation=deviation,
        category=record.category,
        length=max(float(record.extent.max()), usual, 0.02),
        yaw=record.yaw,
    )
