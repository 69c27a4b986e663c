"""Fit the placement model on the development homes, and print the numbers to keep.

    python -m lab.placement.fit ../shared/data

Deterministic. Its output belongs into `kg/knowledge/placement/belief_model.py` (FITTED). Reads
homes/ of the folder; needs numpy only.
"""

from __future__ import annotations

from pathlib import Path

from kg.knowledge.placement.belief_model import FITTED
from lab.command_line import parser_of
from lab.placement.data import Sources, load
from lab.placement.fitting import fit, log_likelihood


def main() -> None:
    """Fit, and print how much likelier the data are than under the numbers that ship."""
    parser = parser_of("lab.placement.fit", __doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    data = load(Sources(folder / "homes", folder / "homes" / "hm3d_room_object_counts.csv"))
    found = fit(data.sample)
    print(f"{len(data.buildings)} buildings, {int((data.sample.rooms > 0).sum())} cells")  # noqa: T201
    print(found)  # noqa: T201
    for name, numbers in (("fitted", found), ("shipped", FITTED)):
        print(f"{name}: log-likelihood {log_likelihood(data.sample, numbers):.2f}")  # noqa: T201


if __name__ == "__main__":
    main()
