"""`python -m benchmarks.graph`: one size after the other, rivals up to a size that is bearable."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.graph import ours, rivals
from benchmarks.graph.loading import furnished
from benchmarks.graph.ours import Flatness, LiveRun
from benchmarks.graph.timing import Timing

MAX_RIVAL_SIZE = 10_000  # objects; beyond it a rival's load alone takes minutes


@dataclass(frozen=True, slots=True)
class GraphBench:
    """Everything that was measured."""

    timings: tuple[Timing, ...]
    driving: LiveRun | None
    leaping: LiveRun | None
    flatness: Flatness | None

    def update_ratio(self) -> float | None:
        """Median cost of an update at the largest size over that at the smallest."""
        updates = [
            t for t in self.timings if (t.operation, t.store) == ("update by a frame", ours.STORE)
        ]
        low, high = min(updates, key=_size), max(updates, key=_size)
        return None if low is high else high.median / low.median

    def over_raw_store(self) -> float:
        """At the smallest size, an update with history over its quads in a bare store; 0: none."""
        smallest = min(timing.objects for timing in self.timings)
        medians = {
            t.store: t.median
            for t in self.timings
            if (t.operation, t.objects) == ("update by a frame", smallest)
        }
        return medians[ours.STORE] / medians[rivals.RAW] if rivals.RAW in medians else 0.0

    def slowest_lookup(self) -> Timing:
        """At the largest size, of the shipped lookups the one with the longest tail."""
        largest = max(timing.objects for timing in self.timings)
        asked = [t for t in self.timings if t.operation in ours.LOOKUPS and t.objects == largest]
        return max(asked, key=lambda t: t.p99)

    def to_json(self) -> dict[str, object]:
        """As a JSON object."""
        flat = self.flatness
        return {
            "timings": [timing.to_json() for timing in self.timings],
            "updateRatio": self.update_ratio(),
            "overRawStore": self.over_raw_store(),
            "slowestLookup": self.slowest_lookup().to_json(),
            "live": self.driving and self.driving.to_json(),
            "leaping": self.leaping and self.leaping.to_json(),
            "lastTenthOverFirst": flat
            and {
                "frames": flat.frames,
                "update": flat.update,
                "lookup": flat.lookup,
                "memory": flat.memory,
                "disk": flat.disk,
            },
        }


def bench_graph(
    sizes: Sequence[int],
    *,
    seconds: float,
    frames: int,
    rivals_most: int = MAX_RIVAL_SIZE,
    say: Callable[[str], None] = lambda _: None,
) -> GraphBench:
    """Measure maps of each size; the largest is then written live for `seconds`, 0 for not at all.

    Live writing is of a robot that drives, and then of one that leaps to anywhere each frame. The
    flatness run applies `frames` frames to the smallest. `say` hears what is being done.
    """
    timings: list[Timing] = []
    driving = leaping = flat = None
    for size in sorted(sizes):
        with tempfile.TemporaryDirectory(prefix="hereabouts-bench-") as name:
            folder = Path(name)
            say(f"furnishing {size:,} objects")
            semantic_map, building = furnished(folder / "bench.map", size)
            with semantic_map:
                say(f"measuring {size:,} objects")
                if size > ours.MAX_EXPORT:
                    say(f"leaving out the export: measured up to {ours.MAX_EXPORT:,} objects")
                timings += ours.measure(semantic_map, building, folder)
                timings += rivals.ours(semantic_map, building)
                if size <= rivals_most:
                    say(f"the same in pyoxigraph, rdflib and owlready2, {size:,} objects")
                    timings += rivals.raw_pyoxigraph(semantic_map, building, folder)
                    timings += rivals.rdflib_memory(semantic_map, building, folder)
                    timings += rivals.owlready_sqlite(semantic_map, building, folder)
                if size == max(sizes) and seconds:
                    say(f"writing 30 frames a second for {seconds:g} s beside two readers")
                    asked = semantic_map, building
                    driving = ours.live(*asked, building.drive, "driving", seconds=seconds)
                    leaping = ours.live(*asked, building.frame, "leaping", seconds=seconds)
                if size == min(sizes) and frames:
                    say(f"{frames:,} frames in a row over {size:,} objects")
                    flat = ours.flatness(semantic_map, building, folder, frames=frames)
    return GraphBench(tuple(timings), driving, leaping, flat)


def _size(timing: Timing) -> int:
    return timing.objects
