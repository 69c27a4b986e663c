"""Counts of a round of kills, as a row of the table."""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import median


@dataclass(slots=True)
class Tally:
    """Counts of one round; `wrong` holds its violations."""

    what: str
    kills: int = 0
    acknowledged: int = 0  # transactions that the killed processes told of
    unheard: int = 0  # transactions that were kept although a kill came before they were told of
    early: int = 0  # kills before the first acknowledgement: while opening and catching up
    checks: int = 0
    opened: list[float] = field(default_factory=list)  # [s] that the map took to open, each time
    notes: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def row(self) -> str:
        """One line of a Markdown table."""
        counts = self.kills, self.acknowledged, self.unheard, self.early, self.checks
        told = "; ".join(self.notes) or "-"
        cells = (
            self.what,
            *(f"{count:,}" for count in counts),
            self._opening(),
            told,
            str(len(self.wrong)),
        )
        return f"| {' | '.join(cells)} |"

    def _opening(self) -> str:
        if not self.opened:
            return "-"
        return f"{1e3 * median(self.opened):.0f} / {1e3 * max(self.opened):.0f}"


_TITLES = (
    "killed",
    "rounds",
    "acknowledged",
    "kept unheard",
    "early",
    "checks",
    "opened again, median / longest [ms]",
    "besides",
    "violations",
)
HEAD = f"| {' | '.join(_TITLES)} |\n{'|---' * len(_TITLES)}|"
