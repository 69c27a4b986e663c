"""Outcome of a family of attacks: what was tried, and what it did."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Final

HEAD: Final = ("attempts", "escapes", "crashes", "hangs", "data lost", "memory", "tracebacks")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Counts; all but `attempts` have to be 0."""

    attempts: int = 0
    escapes: int = 0  # connections that arrived at the listener
    crashes: int = 0  # deaths of the server
    hangs: int = 0  # answers of bystanders that took longer than `target.PATIENCE`
    lost: int = 0  # acknowledged facts that are gone
    memory: int = 0  # processes that took more than 2 GB
    tracebacks: int = 0  # shown to users

    def __add__(self, other: Outcome) -> Outcome:
        return Outcome(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    @property
    def held(self) -> bool:
        """Whether nothing happened."""
        return not any(astuple(self)[1:])
