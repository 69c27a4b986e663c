"""A file that may not grow any further, as on a full disk."""

import subprocess
import sys
from pathlib import Path

import pytest

_SCRIPT = """
import resource, sys
from pathlib import Path
import numpy as np
from kg.model.errors import PictureError
from perception.frames import Detections, Frame
from hereabouts.display.viewers import foxglove_viewer, rerun_viewer

path = Path(sys.argv[1])
foxglove_viewer.FLUSHED, rerun_viewer._PATIENCE = 0.0, 1.0
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
mcap = path.suffix == ".mcap"
viewer = foxglove_viewer.McapFile(path) if mcap else rerun_viewer.RerunFile("x", path)
rgb = np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8)
nothing = Detections(np.empty((0, 4), np.float32), np.empty(0, np.float32), ())
try:
    for stamp in range(20):
        frame = Frame("f", rgb, np.ones((240, 320), np.float32), np.eye(3), np.eye(4), float(stamp))
        viewer.frame(frame, nothing)
    viewer.close()
except PictureError as error:
    print(error)
"""


@pytest.mark.parametrize("name", ["out.mcap", "out.rrd"])
def test_a_full_disk_is_one_line_and_the_process_ends(tmp_path: Path, name: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(tmp_path / name)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert ended.stdout.startswith(f"cannot write {tmp_path / name}: ")
    assert ended.stdout.count("\n") == 1
