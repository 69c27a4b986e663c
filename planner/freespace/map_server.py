"""Occupancy grids as files of ROS' map_server (YAML and image), read and written, or numpy arrays.

The convention of map_server (http://wiki.ros.org/map_server): row 0 of the image is the largest y;
occupancy is (255 - value) / 255, or value / 255 with `negate: 1`; above `occupied_thresh` a cell is
occupied, below `free_thresh` free, between unknown; `origin` is the pose of the lower left corner.
The image may be an npy array instead, of occupancies as in nav_msgs/OccupancyGrid: (rows, columns),
-1 for unknown and 0 to 100 else, row 0 at the smallest y. Files are written as map_saver writes
them, with 254 for free, 0 for occupied and 205 for unknown.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area
from kg.model.errors import LayoutError
from kg.model.regular_files import check_regular, read_bytes
from kg.store.folder import write_atomically
from mapping.occupancy.mapped_floor import MappedFloor
from planner.freespace.grid import FreeSpace, Occupancy, space_of_occupancy

_OCCUPIED: Final = "0.65"  # map_server's defaults
_FREE: Final = "0.196"
_MAX_PIXELS: Final = 25_000_000  # 250 m x 250 m at 0.05 m
_MAX_BYTES: Final = 100_000  # bytes of a YAML file


def space_of_grid(path: Path, places: Sequence[Area]) -> FreeSpace:
    """Free space of a map_server YAML file; rooms as in `space_of_occupancy`.

    Raises LayoutError, in one line, where the file or its image cannot be read or has no floor.
    """
    grid = read_grid(path)
    try:
        return space_of_occupancy(grid, places)
    except LayoutError as error:
        raise LayoutError(f"{path.name}: {error}") from None


def read_grid(path: Path) -> Occupancy:
    """The grid of a map_server YAML file and the PGM or npy file it names; raises LayoutError."""
    keys = _keys(path)
    try:
        resolution = float(keys["resolution"])
        origin = [float(number) for number in keys["origin"].strip("[] ").split(",")]
        negate = bool(int(keys.get("negate", "0")))
        solid = float(keys.get("occupied_thresh", _OCCUPIED))
        clear = float(keys.get("free_thresh", _FREE))
        image = path.parent / keys["image"]
    except KeyError as missing:
        raise LayoutError(
            f"{path.name}: no {missing}; a map_server file has image, resolution and origin"
        ) from None
    except ValueError as wrong:
        raise LayoutError(f"{path.name}: {wrong}") from None
    _check(path, keys, origin)
    occupancy = _occupancy(image, negate)
    try:
        free, occupied = (occupancy < clear).T, (occupancy > solid).T
        return Occupancy(free & ~occupied, occupied, np.array(origin[:2]), resolution)
    except LayoutError as error:
        raise LayoutError(f"{path.name}: {error}") from None


def places_file(path: Path) -> Path:
    """The file of places that a map_server YAML file names with the key `places`.

    map_server itself has no labels, and ignores unknown keys. Raises LayoutError.
    """
    name = _keys(path).get("places")
    if not name:
        raise LayoutError(
            f"{path.name}: no 'places'; a line 'places: rooms.geojson' would work, a file of "
            "polygons in the map's frame"
        )
    return path.parent / name


def _check(path: Path, keys: Mapping[str, str], origin: Sequence[float]) -> None:
    if keys.get("mode", "trinary") != "trinary":
        raise LayoutError(f"{path.name}: mode {keys['mode']} is not read, only trinary")
    if len(origin) != 3 or not abs(origin[2]) <= 1e-6:
        raise LayoutError(f"{path.name}: origin must be [x, y, 0]; a turned map is not read")


def _occupancy(image: Path, negate: bool) -> NDArray[np.float64]:
    """(rows, columns) occupancy 0..1, row 0 at the smallest y; 0.5 where it is unknown."""
    if image.suffix.lower() == ".npy":
        return _of_npy(image)
    values = _of_pgm(image)[::-1]
    return values if negate else 1.0 - values


def _of_npy(image: Path) -> NDArray[np.float64]:
    try:
        check_regular(image)
        values = np.load(image, allow_pickle=False, mmap_mode="r")  # no more than the file has
        known = np.asarray(values, np.float64)
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise LayoutError(f"{image.name} is not an npy array of numbers") from error
    if known.ndim != 2 or not ((known == -1) | ((known >= 0) & (known <= 100))).all():
        raise LayoutError(
            f"{image.name} must hold (rows, columns) of -1 or 0 to 100, got shape {known.shape}"
        )
    return np.where(known < 0, 0.5, known / 100)


def _keys(path: Path) -> dict[str, str]:
    """The flat `key: value` lines of a YAML file; items of a list below a key, joined by commas."""
    try:
        text = read_bytes(path, _MAX_BYTES).decode("utf-8")
    except UnicodeDecodeError as error:
        raise LayoutError(f"{path.name} is no map_server file: it is not text") from error
    except OSError as error:
        raise LayoutError(f"cannot read {path.name}: {error.strerror}") from error
    keys: dict[str, str] = {}
    last = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("- ") and last:
            keys[last] = f"{keys[last]},{_scalar(line[2:])}".strip(",")
        elif ":" in line and not line.startswith("#"):
            last, _, value = (part.strip() for part in line.partition(":"))
            keys[last] = _scalar(value)
    return keys


_QUOTED = re.compile(r"""("(?:[^"\\]|\\.)*"|'(?:[^']|'')*')\s*(?:\s\#.*)?""")


def _scalar(text: str) -> str:
    """A value without quotes and comment; ``#`` within quotes begins no comment."""
    text = text.strip()
    quoted = _QUOTED.fullmatch(text)
    if quoted is None:
        return re.sub(r"(^|\s)#.*", "", text).strip()
    inside = quoted[1][1:-1]
    if quoted[1].startswith("'"):
        return inside.replace("''", "'")
    return re.sub(r"\\(.)", r"\1", inside)


_HEADER = re.compile(
    rb"P([25])(?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s"
)


def _of_pgm(path: Path) -> NDArray[np.float64]:
    """(rows, columns) values 0..1 of a PGM image, plain or binary."""
    try:
        data = read_bytes(path, 8 * _MAX_PIXELS)
    except OSError as error:
        raise LayoutError(f"cannot read the map's image {path.name}: {error.strerror}") from error
    header = _HEADER.match(data[:10_000])
    if header is None:
        raise LayoutError(f"{path.name} is not a PGM image (P2 or P5)")
    columns, rows, max_value = (int(header[k]) for k in (2, 3, 4))
    if not (0 < max_value < 65536 and 0 < rows * columns <= _MAX_PIXELS):
        raise LayoutError(
            f"{path.name}: {columns} x {rows} pixels up to {max_value} are no image that is read"
        )
    values = _pixels(data[header.end() :], header[1] == b"5", max_value, path)
    if len(values) < rows * columns or values[: rows * columns].max() > max_value:
        raise LayoutError(
            f"{path.name} is damaged: {columns} x {rows} pixels up to {max_value} were announced"
        )
    return np.asarray(values[: rows * columns].reshape(rows, columns) / max_value, np.float64)


def _pixels(body: bytes, binary: bool, max_value: int, path: Path) -> NDArray[np.float64]:
    if not binary:
        try:
            return np.array(body.split(), np.float64)
        except ValueError as error:
            raise LayoutError(f"{path.name} is damaged: a pixel is no number") from error
    wide = max_value > 255
    return np.frombuffer(body[: len(body) // 2 * 2] if wide else body, ">u2" if wide else "u1")


#: by UNKNOWN, FREE, LOW, TALL: a low obstacle is occupied, since it stops a robot
_SHADES: Final = np.array([205, 254, 0, 0], np.uint8)
_PLAIN: Final = re.compile(r"[A-Za-z]\w*(?:[.-]\w+)*")
_ENDINGS: Final = (".yaml", ".yml")


def write_grid(floor: MappedFloor, path: Path) -> Path:
    """Write `floor` to the YAML file `path` and a PGM beside it; returns the image's path.

    Raises LayoutError for another ending or a name with control characters, GraphError where a file
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
    """`name`, quoted unless YAML reads it as text."""
    return name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)
