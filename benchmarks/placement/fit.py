"""Fit the placement model on the development homes and S3DIS, and print the numbers to keep.

    python benchmarks/placement/fit.py ../shared/data

Deterministic. What it prints belongs into `kg/placement/settings.py` (FITTED, HOMES, OFFICES).
Reads homes/, s3dis/ and conceptnet/ of the folder; needs numpy only.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path

from benchmarks.placement.data import Sources, load
from benchmarks.placement.fitting import fit, fit_kind, log_likelihood
from kg.placement.settings import FITTED, PlacementParameters


def main(folder: Path) -> None:
    """Fit, and say how much likelier the data are than under the numbers that ship."""
    data = load(
        Sources(
            homes=folder / "homes",
            statistics=folder / "homes" / "hm3d_room_object_counts.csv",
            s3dis=folder / "s3dis" / "rooms_objects.csv",
            conceptnet=folder / "conceptnet" / "object_room_scores.json",
        )
    )
    found = fit(data.sample)
    kept = _rounded(found)
    print(f"{len(data.buildings)} buildings, {int((data.sample.rooms > 0).sum())} cells")  # noqa: T201
    print(kept)  # noqa: T201
    for name, numbers in (("fitted", found), ("rounded", kept), ("shipped", FITTED)):
        print(f"{name}: log-likelihood {log_likelihood(data.sample, numbers):.2f}")  # noqa: T201
    count = len(data.buildings)
    for name, which in (("HOMES", range(data.homes)), ("OFFICES", range(data.homes, count))):
        print(name, _rounded(fit_kind(data.sample.only(which), kept)))  # noqa: T201


def _rounded(numbers: PlacementParameters) -> PlacementParameters:
    return PlacementParameters(**{name: float(f"{x:.3g}") for name, x in asdict(numbers).items()})


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
