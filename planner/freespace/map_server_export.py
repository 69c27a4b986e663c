"""The mapped floor as the files of ROS' map_server, for a robot's own navigation.

As map_saver writes them (http://wiki.ros.org/map_server): a YAML file, and beside it a PGM image
with 254 for free, 0 for occupied and 205 for unknown, row 0 at the largest y.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final

import numpy as np

from kg.errors import LayoutError
from kg.store.atomic_file import write_atomically
from mapping.occupancy.mapped_floor import MappedFloor

#: by UNKNOWN, FREE, LOW, TALL: what one looks over stops a robot all the same
_SHADES: Final = np.array([205, 254, 0, 0], np.uint8)
_PLAIN: Final = re.compile(r"[A-Za-z]\w*(?:[.-]\w+)*")
_ENDINGS: Final = (".yaml", ".yml")


def write_grid(floor: MappedFloor, path: Path) -> Path:
    """Write `floor` to the YAML file `path` and a PGM beside it; returns the image's path.

    Raises LayoutError for another ending or a name that is no text, GraphError where one of them
    cannot be written.
    """
    if path.suffix.lower() not in _ENDINGS:
        raise LayoutError(
            f"{path.name}: a map_server file ends with .yaml, and its image with .pgm"
        )
    if not path.name.isprintable():
        raise LayoutError(f"{path.name!r}: the image is named in the YAML file, so it must be text")
    floor = floor.cropped()
    x, y = (float(c) for c in floor.origin)
    rows = _SHADES[floor.states].T[::-1]
    image = path.with_suffix(".pgm")
    header = f"P5\n{rows.shape[1]} {rows.shape[0]}\n255\n".encode("ascii")
    write_atomically(image, header + np.ascontiguousarray(rows).tobytes())
    write_atomically(
        path,
        f"image: {_as_yaml(image.name)}\n"
        "mode: trinary\n"
        f"resolution: {floor.resolution:g}\n"
        f"origin: [{x:.4f}, {y:.4f}, 0.0]\n"
        "negate: 0\n"
        "occupied_thresh: 0.65\n"
        "free_thresh: 0.196\n",
    )
    return image


def _as_yaml(name: str) -> str:
    """`name` as it is where YAML takes it for text, quoted elsewhere."""
    return name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)
