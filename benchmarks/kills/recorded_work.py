"""Work on a map that is recorded: created, written, compacted, closed and opened again.

python -m benchmarks.kills.recorded_work MAP SEED [power-safe]

It says "told FRAMES NOTES" after each acknowledged transaction.
"""

from __future__ import annotations

import os
import random
import sys
import time
from pathlib import Path

from benchmarks.kills.frames import BASE, frame_update, note_update
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map, open_map
from kg.store import scheduling

SESSIONS = 3
STEPS = 12  # of a session
FLUSH_EVERY = 0.03  # [s]: as often beside these steps as a map's flushes beside a robot's frames


def main() -> None:
    """Create the map and work on it."""
    path, rng, power_safe = Path(sys.argv[1]), random.Random(sys.argv[2]), len(sys.argv) > 3
    done = 0, 0
    scheduling.FLUSH_EVERY = FLUSH_EVERY
    for session in range(SESSIONS):
        opened = (
            open_map(path, power_safe=power_safe)
            if session
            else create_map(path, base=BASE, power_safe=power_safe)
        )
        with opened as semantic_map:
            _tell(*done)
            for _ in range(STEPS):
                done = _step(semantic_map, rng, *done)


def _step(
    semantic_map: SemanticMap, rng: random.Random, frames: int, notes: int
) -> tuple[int, int]:
    chosen = rng.random()
    if chosen < 0.08:
        semantic_map.history.compact()
    elif chosen < 0.16:
        semantic_map.history.compact(0.0)
    elif chosen < 0.3:
        time.sleep(2 * FLUSH_EVERY)
    elif chosen < 0.5:
        notes += 1
        semantic_map.update(note_update(notes))
        _tell(frames, notes)
    else:
        semantic_map.apply(frame_update(frames))
        frames += 1
        _tell(frames, notes)
    return frames, notes


def _tell(frames: int, notes: int) -> None:
    os.write(1, f"told {frames} {notes}\n".encode())


if __name__ == "__main__":
    main()
