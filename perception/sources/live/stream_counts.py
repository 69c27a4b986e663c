"""Counts of a live stream's images, by their use."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class StreamCounts:
    """Counts of the received colour images, by their use."""

    received: int = 0
    taken: int = 0  # given to be mapped
    without_depth: int = 0  # within the tolerance
    without_pose: int = 0
    unreadable: int = 0  # images that cannot be decoded, or change their size

    @property
    def dropped(self) -> int:
        """Images that newer ones replaced while an earlier one was mapped, and unused last ones."""
        lost = self.without_depth + self.without_pose + self.unreadable
        return self.received - self.taken - lost
