"""Counts of a round of kills, as a row of the table."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Tally:
    """Counts of one round; `wrong` holds its violations."""

    what: str
    kills: int = 0
    acknowledged: int = 0  # transactions that the killed processes told of
    unheard: int = 0  # transactions that were kept although a kill came before they were told of
    early: int = 0  # kills before the first acknowledgement: while opening and catching up
    checks: int = 0
    notes: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def row(self) -> str:
        """One line of a Markdown table."""
        counts = self.kills, self.acknowledged, self.unheard, self.early, self.checks
        told = "; ".join(self.notes) or "-"
        cells = (self.what, *(f"{count:,}" for count in counts), told, str(len(self.wrong)))
        return f"| {' | '.join(cells)} |"


HEAD = (
    "| killed | kills | acknowledged | kept unheard | early | checks | besides | violations |\n"
    "|---|---|---|---|---|---|---|---|"
)
