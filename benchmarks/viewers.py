"""Cost of a mapping run's export for viewers: processor time and bytes for each frame.

    python -m benchmarks.viewers MAP RECORDING

Feeds the recording's first 120 frames, with ten detections each, and the scene of the finished map
to an MCAP and an .rrd file; nothing is mapped.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from itertools import islice
from pathlib import Path

import numpy as np

from hereabouts.display.viewers.feed import MappingFeed
from hereabouts.display.viewers.foxglove_viewer import McapFile
from hereabouts.display.viewers.rerun_viewer import RerunFile
from kg.serving.opening import open_map
from perception.frames import Detections
from perception.sources.recording import open_recording

FRAMES = 120
BOXES = np.tile(np.array([[10, 20, 100, 90]], np.float32), (10, 1))
DETECTIONS = Detections(BOXES, np.full(10, 0.5, np.float32), ("cup",) * 10)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("recording", type=Path)
    arguments = parser.parse_args()
    frames = list(islice(open_recording(arguments.recording).frames(), FRAMES))
    with (
        open_map(arguments.map, read_only=True) as semantic_map,
        tempfile.TemporaryDirectory() as folder,
    ):
        for path in (Path(folder) / "out.mcap", Path(folder) / "out.rrd"):
            viewer = McapFile(path) if path.suffix == ".mcap" else RerunFile("benchmark", path)
            feed = MappingFeed(semantic_map, viewer)
            before = time.process_time()
            for frame in frames:
                feed.on_detections(frame, DETECTIONS, None)
            viewer.close()
            spent = 1000 * (time.process_time() - before) / len(frames)
            size = path.stat().st_size / len(frames) / 1000
            print(f"{path.suffix[1:]}: {spent:.1f} ms and {size:.0f} kB a frame")  # noqa: T201


if __name__ == "__main__":
    main()
