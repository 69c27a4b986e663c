"""Wire format of a surface, for `/surface`: a JSON header, then arrays, all little-endian.

4 bytes   length of the header, which is padded with spaces to a multiple of 4 bytes
header    {"size": 0.025, "origin": [x, y, z], "voxels": n}, in metres of the map frame
n x 4     last_seen [s since 1970], uint32
n x 2     each of x, y, z, int16: the centre is origin + size * (x, y, z)
n x 2     count, uint16
n x 1     each of red, green, blue, uint8
"""

from __future__ import annotations

import json
from typing import Final

import numpy as np

from kg.maps.surface.voxels import Surface, coarser

MEDIA_TYPE: Final = "application/vnd.hereabouts.surface"
MAX_VOXELS: Final = 300_000  # of one answer; larger surfaces are joined into larger voxels
_REACH: Final = 32_000  # voxels from the origin
_COLUMNS: Final = (("<u4", 1), ("<i2", 3), ("<u2", 1), ("u1", 3))


def encoded(surface: Surface, max_voxels: int = MAX_VOXELS) -> bytes:
    """Bytes of a surface, with larger voxels where it has more than `max_voxels`."""
    surface = coarser(surface, max_voxels)
    while len(surface) and np.ptp(surface.points, axis=0).max() > 2 * _REACH * surface.size:
        surface = coarser(surface, len(surface) - 1)
    n = len(surface)
    low, high = (surface.points.min(0), surface.points.max(0)) if n else (np.zeros(3), np.zeros(3))
    origin = low + np.floor((high - low) / 2 / (surface.size or 1)) * surface.size
    cells = np.rint((surface.points - origin) / (surface.size or 1)).astype("<i2")
    values = {"size": surface.size, "origin": origin.astype(float).tolist(), "voxels": n}
    header = json.dumps(values).encode()
    header += b" " * (-len(header) % 4)
    columns = (
        surface.last_seen.astype("<u4"),
        cells.T,
        surface.count.astype("<u2"),
        surface.colours.T,
    )
    parts = [column.tobytes() for column in columns]
    return b"".join([len(header).to_bytes(4, "little"), header, *parts])


def decoded(data: bytes) -> Surface:
    """Surface of `encoded` bytes; raises ValueError for others."""
    start = 4 + int.from_bytes(data[:4], "little")
    header = json.loads(data[4:start])
    n, columns = int(header["voxels"]), []
    for kind, width in _COLUMNS:
        columns.append(np.frombuffer(data, kind, n * width, start).reshape(width, n))
        start += n * width * np.dtype(kind).itemsize
    last, cells, count, colours = columns
    points = cells.T * float(header["size"]) + np.array(header["origin"], np.float64)
    return Surface(
        size=float(header["size"]),
        points=points.astype(np.float32),
        colours=np.ascontiguousarray(colours.T),
        count=count[0],
        last_seen=last[0].astype(np.float64),
    )
