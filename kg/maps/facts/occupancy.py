"""Occupancy tiles: records to quads of graph:map, and back. A tile's cells are one literal."""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.query.evaluation import Value
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import TALL, FloorTile
from kg.rdf.literals import number_literal, properties_of, seconds, time_literal
from kg.rdf.quad_store import QuadStore
from kg.store.sparql_backend import reading_ahead

#: cells along a side of a tile; limits untrusted input
MAX_CELLS: Final = 1024
#: tiles along x or y from the origin of the map
MAX_TILES: Final = 1 << 20

_KIND = NamedNode(v.FLOOR_TILE)


def tile_iri(base: str, storey: int, column: int, row: int) -> str:
    """IRI of a tile in the map with IRI `base`."""
    return f"{base}floor/{storey}/{column}_{row}"


def iri_of(base: str, tile: FloorTile) -> str:
    """IRI of `tile` in the map with IRI `base`."""
    return tile_iri(base, tile.storey, tile.column, tile.row)


def facts_of_tile(base: str, tile: FloorTile) -> list[Quad]:
    """Facts of a tile.

    Raises InvalidFactError for a tile that is not square, has no size, or is too far away.
    """
    iri = iri_of(base, tile)
    sides = tile.cells.shape
    if len(sides) != 2 or sides[0] != sides[1] or not 0 < sides[0] <= MAX_CELLS:
        raise InvalidFactError(
            f"{iri}: cells must be (n, n), n up to {MAX_CELLS}, got {tile.cells.shape}"
        )
    if tile.cells.max() > TALL or tile.storey < 0 or not 0 < tile.resolution < math.inf:
        raise InvalidFactError(
            f"{iri}: cells must be 0 to {TALL}, the storey 0 or more and the resolution above 0 m"
        )
    if max(abs(tile.column), abs(tile.row)) > MAX_TILES:
        raise InvalidFactError(f"{iri}: a tile is up to {MAX_TILES} tiles from the origin")
    x, y = tile.corner
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, _KIND),
        (v.STOREY, Literal(tile.storey)),
        (v.X, number_literal(x, f"{iri}: position")),
        (v.Y, number_literal(y, f"{iri}: position")),
        (v.Z, number_literal(tile.height, f"{iri}: position")),
        (v.CELL_SIZE, Literal(float(tile.resolution))),
        (v.FLOOR_CELLS, Literal(encoded(tile.cells), datatype=v.XSD_BASE64)),
        (v.SOSA_RESULT_TIME, time_literal(tile.changed, f"{iri}: the time")),
    ]
    if tile.viewed is not None:
        if not _are_view_times(tile.viewed):
            raise InvalidFactError(
                f"{iri}: times of views must be (2, m, m), m up to {MAX_CELLS}, got "
                f"{tile.viewed.shape}"
            )
        facts.append((v.VIEW_TIMES, Literal(encoded_times(tile.viewed), datatype=v.XSD_BASE64)))
    node = NamedNode(iri)
    return [Quad(node, NamedNode(predicate), value, v.MAP_GRAPH) for predicate, value in facts]


def tiles_in(engine: QuadStore) -> tuple[FloorTile, ...]:
    """All tiles of the map, by storey, column and row; incomplete ones are left out."""
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, _KIND, v.MAP_GRAPH)
    nodes = [quad.subject for quad in quads if isinstance(quad.subject, NamedNode)]
    with reading_ahead(engine, nodes):
        read = [tile_of(engine, node.value) for node in nodes]
    found = [tile for tile in read if tile is not None]
    return tuple(sorted(found, key=lambda tile: (tile.storey, tile.column, tile.row)))


def tile_of(engine: QuadStore, iri: str) -> FloorTile | None:
    """The tile with that IRI, or None."""
    return _tile(properties_of(engine, iri, v.MAP_GRAPH))


def encoded(cells: NDArray[np.uint8]) -> str:
    """Cells (n, n) encoded as in here:floorCells."""
    return _packed(np.ascontiguousarray(cells, np.uint8).tobytes())


def decoded(text: str) -> NDArray[np.uint8] | None:
    """Cells (n, n) decoded from a here:floorCells; None where it is not valid."""
    data = _unpacked(text, MAX_CELLS**2)
    side = math.isqrt(len(data))
    if not data or side * side != len(data):
        return None
    cells = np.frombuffer(data, np.uint8).reshape(side, side)
    return cells if cells.max() <= TALL else None


def encoded_times(viewed: NDArray[np.uint32]) -> str:
    """Times of views (2, m, m) encoded as in here:viewTimes."""
    return _packed(np.ascontiguousarray(viewed, "<u4").tobytes())


def decoded_times(text: str) -> NDArray[np.uint32] | None:
    """Times of views (2, m, m) decoded from a here:viewTimes; None where it is not valid."""
    data = _unpacked(text, 8 * MAX_CELLS**2)
    side = math.isqrt(len(data) // 8)
    if not data or 8 * side * side != len(data):
        return None
    return np.frombuffer(data, "<u4").astype(np.uint32).reshape(2, side, side)


def _packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 9)).decode("ascii")


def _unpacked(text: str, max_bytes: int) -> bytes:
    """Up to `max_bytes` bytes of a zlib stream in base64; empty where it is invalid or longer."""
    unpack = zlib.decompressobj()
    try:
        data = unpack.decompress(base64.b64decode(text, validate=True), max_bytes + 1)
    except (binascii.Error, ValueError, zlib.error):
        return b""
    return data if unpack.eof and len(data) <= max_bytes else b""


def _are_view_times(viewed: NDArray[np.uint32]) -> bool:
    shape = viewed.shape
    return len(shape) == 3 and shape[0] == 2 and 0 < shape[1] == shape[2] <= MAX_CELLS


def tiles_of_rows(rows: Iterable[Mapping[str, Value]]) -> tuple[FloorTile, ...]:
    """Tiles of the rows of `queries/goals-floor.rq`, in their order; other rows are left out."""
    found: dict[str, FloorTile] = {}
    for row in rows:
        changed = row["changed"]
        if not isinstance(changed, datetime) or str(row["iri"]) in found:
            continue
        metres = (row["x"], row["y"], row["z"], row["cellSize"])
        tile = _made(row["storey"], metres, row["cells"], changed.timestamp())
        if tile is not None:
            found[str(row["iri"])] = tile
    return tuple(found.values())


def _tile(properties: Mapping[str, list[str]]) -> FloorTile | None:
    """Tile parsed from its properties; None where they are not valid."""
    try:
        metres = [min(properties[p]) for p in (v.X, v.Y, v.Z, v.CELL_SIZE)]
        changed = seconds(min(properties[v.SOSA_RESULT_TIME]))
        tile = _made(min(properties[v.STOREY]), metres, min(properties[v.FLOOR_CELLS]), changed)
    except (KeyError, ValueError):
        return None
    viewed = decoded_times(min(properties.get(v.VIEW_TIMES, ("",))))
    return tile if tile is None or viewed is None else replace(tile, viewed=viewed)


def _made(storey: Value, metres: Sequence[Value], text: Value, changed: float) -> FloorTile | None:
    """Tile from x, y, z and cell size (4,) and its cells; None where they are not valid."""
    cells = decoded(str(text))
    try:
        x, y, z, size = (float(str(number)) for number in metres)
        number = int(str(storey))
        if cells is None or number < 0 or not all(map(math.isfinite, (x, y, z, size))):
            return None
        span = size * len(cells)
        column, row = round(x / span), round(y / span)
        if not math.isfinite(span) or max(abs(column), abs(row)) > MAX_TILES:
            return None
    except (ValueError, ZeroDivisionError, OverflowError):
        return None
    if size <= 0 or max(abs(x - column * span), abs(y - row * span)) > 0.01:
        return None  # not aligned with the grid
    return FloorTile(number, column, row, z, size, cells, changed)
