"""Surface of a recording: time of a core a frame, voxels and bytes of the file.

python -m benchmarks.surface ../shared/data/rgbd/redkitchen
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from kg.maps.surface.surface_store import FILE
from kg.serving.opening import create_map
from mapping.surface.surface_mapper import SurfaceMapper
from perception.sources.recording import open_recording

NO_PEOPLE = np.empty((0, 4), np.float32)


def main() -> None:
    """Map the surface alone of one recording."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recording")
    parser.add_argument("--cm", type=float, default=2.5, help="side of a voxel")
    given = parser.parse_args()
    seconds, frames = 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.map"
        with create_map(path) as semantic_map:
            mapper = SurfaceMapper(semantic_map, given.cm / 100, "benchmark")
            for frame in open_recording(given.recording).frames():
                before = time.thread_time()
                mapper.add(frame, NO_PEOPLE)
                mapper.save(semantic_map.sequence)
                mapper.accept()
                seconds, frames = seconds + time.thread_time() - before, frames + 1
            before = time.thread_time()
            mapper.finish()
            seconds += time.thread_time() - before
            voxels = len(semantic_map.surface())
        size = (path / FILE).stat().st_size
    print(f"{frames} frames, {1000 * seconds / frames:.2f} ms of a core each")  # noqa: T201
    print(f"{voxels:,} voxels, {size:,} bytes, {size / voxels:.1f} a voxel")  # noqa: T201


if __name__ == "__main__":
    main()
