"""Literals and IRIs of facts, quantised and validated, and the properties of a subject.

Geometries are well-known text (OGC Simple Features, part 1; GeoSPARQL's wktLiteral).
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.areas import MAX_COORDINATE, Area, Outline, area_of
from kg.model.errors import InvalidFactError
from kg.model.vocabulary import CELL
from kg.rdf.quad_store import QuadStore

if TYPE_CHECKING:
    import shapely


_ESCAPE: Final = re.compile(r"\\(.)")
_ESCAPED: Final = {"t": "\t", "n": "\n", "r": "\r", "b": "\b", "f": "\f"}
_DATE_TIME = NamedNode(v.XSD + "dateTime")


def date_time(stamp: float) -> Literal:
    """The xsd:dateTime of `stamp` [s], to the second.

    Raises:
        ValueError, OverflowError, OSError: the year is outside of 1 to 9999.
    """
    return _at_second(round(stamp))


@lru_cache(maxsize=1024)
def _at_second(second: int) -> Literal:
    moment = datetime.fromtimestamp(second, UTC)
    # strftime writes years before 1000 without their leading zeros
    return Literal(moment.strftime("%Y-%m-%dT%H:%M:%SZ").zfill(20), datatype=_DATE_TIME)


def seconds(text: str) -> float:
    """Seconds since 1970 of the lexical form of an xsd:dateTime; UTC without a time zone."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def transaction_time() -> float:
    """The current time [s] in whole milliseconds, the precision of `--at` and of the feeds."""
    return time.time_ns() // 1_000_000 / 1000


def now() -> Literal:
    """The current time."""
    return date_time(time.time())


#: predicate IRI -> objects (IRIs and lexical forms) of one subject
Properties = dict[str, list[str]]
AXES: Final = (v.X, v.Y, v.Z)
SIDES: Final = (v.EXTENT_X, v.EXTENT_Y, v.EXTENT_Z)


@lru_cache(maxsize=4096)
def known_iri(iri: str) -> NamedNode:
    """Cached node of a frequent IRI: of the vocabulary, a category, a cell or a place."""
    return NamedNode(iri)


def iri_node(text: str, what: str) -> NamedNode:
    """Node of the IRI `text`. Raises InvalidFactError, which names `what`, for an invalid IRI."""
    try:
        return NamedNode(text)
    except ValueError as error:
        raise InvalidFactError(f"{what} must be an absolute IRI, got {text!r}") from error


def quantised(value: float, what: str, digits: int = 2) -> float:
    """`value` rounded to `digits`. Raises InvalidFactError for a value that is not finite."""
    number = float(value)
    if not math.isfinite(number):
        raise InvalidFactError(f"{what} must be a finite number, got {number}")
    return round(number, digits) + 0.0  # + 0.0 turns minus zero into zero


def number_literal(
    value: float,
    what: str,
    *,
    digits: int = 2,
    minimum: float = -MAX_COORDINATE,
    maximum: float = MAX_COORDINATE,
) -> Literal:
    """Literal of `value`, quantised; the usual bounds are those of lengths [m].

    Raises InvalidFactError if not finite or out of bounds.
    """
    number = quantised(value, what, digits)
    if not minimum <= number <= maximum:
        raise InvalidFactError(f"{what} must be within {minimum:g}..{maximum:g}, got {number:g}")
    return Literal(number)


def time_literal(stamp: float, what: str) -> Literal:
    """xsd:dateTime of `stamp` [s since 1970]. Raises InvalidFactError if out of range."""
    try:
        return date_time(stamp)
    except (ValueError, OverflowError, OSError) as error:
        raise InvalidFactError(
            f"{what} must be seconds since 1970 within years 1 to 9999, got {stamp}"
        ) from error


def subject_quads(
    subject: str, facts: Iterable[tuple[str, NamedNode | Literal]], graph: NamedNode = v.MAP_GRAPH
) -> list[Quad]:
    """Quads of one subject (an IRI) with those predicates (IRIs) and values."""
    node = iri_node(subject, "subject")
    return [Quad(node, known_iri(predicate), value, graph) for predicate, value in facts]


def share_literal(value: float, what: str) -> Literal:
    """Literal of a share or a probability. Raises InvalidFactError outside of 0..1."""
    return number_literal(value, what, minimum=0.0, maximum=1.0)


def axis_literals(
    predicates: Sequence[str],
    values: NDArray[np.float64],
    what: str,
    *,
    minimum: float = -MAX_COORDINATE,
) -> list[tuple[str, Literal]]:
    """One literal [m] for each of three axes. Raises InvalidFactError for other shapes."""
    if np.shape(values) != (3,):
        raise InvalidFactError(f"{what} must have shape (3,), got {np.shape(values)}")
    return [
        (predicate, number_literal(value, what, minimum=minimum))
        for predicate, value in zip(predicates, values, strict=True)
    ]


def yaw_literals(yaw: float, what: str) -> list[tuple[str, Literal]]:
    """The literal of a box's `yaw` [rad]; none for a box along the map's axes."""
    turned = number_literal(yaw, f"{what}: yaw", minimum=-math.pi, maximum=math.pi)
    return [] if float(turned.value) == 0 else [(v.YAW, turned)]


def axes_of(
    properties: Mapping[str, Sequence[str]], predicates: Sequence[str]
) -> NDArray[np.float64]:
    """(3,) [m] values of three axes; 0 for a missing one."""
    return np.array([float(first(properties, predicate, "0")) for predicate in predicates])


def properties_of(engine: QuadStore, subject: str, graph: NamedNode) -> Properties:
    """Properties of the subject with IRI `subject` in `graph`."""
    properties: Properties = {}
    for quad in engine.quads_for_pattern(NamedNode(subject), None, None, graph):
        properties.setdefault(quad.predicate.value, []).append(text_of(quad.object))
    return properties


def by_subject(quads: Iterable[Quad]) -> dict[str, Properties]:
    """Properties of each subject of `quads`, from all graphs."""
    subjects: dict[str, Properties] = {}
    for subject, predicate, value, _ in quads:
        properties = subjects.setdefault(text_of(subject), {})
        properties.setdefault(predicate.value, []).append(text_of(value))
    return subjects


def text_of(term: object) -> str:
    """IRI or lexical form of a term."""
    return str(getattr(term, "value", term))


def tsv_text(cell: str) -> str:
    """IRI or lexical form of a term in SPARQL results in TSV, which write numbers bare."""
    mark = cell[:1]
    if mark == "<":
        return cell[1:-1]
    if mark != '"':
        return cell
    text = cell[1 : cell.rindex('"')]
    return _ESCAPE.sub(_unescaped, text) if "\\" in text else text


def _unescaped(match: re.Match[str]) -> str:
    return _ESCAPED.get(match[1], match[1])


def first(properties: Mapping[str, Sequence[str]], predicate: str, default: str) -> str:
    """The smallest value of a property, so that the choice is deterministic."""
    return min(properties.get(predicate, ()), default=default)


def stamp_of(properties: Mapping[str, Sequence[str]], predicate: str) -> float:
    """Time of a property [s since 1970]; 0 for a missing one."""
    return seconds(first(properties, predicate, "1970-01-01T00:00:00Z"))


def iri_order(iri: str) -> tuple[int, str]:
    """Sort key that orders IRIs by their final numbers."""
    return len(iri), iri


SIDE = 5.0  # [m]
MAX_CELLS = 2500  # in a query; with more, a plain filter is as quick


def cell_of(x: float, y: float) -> str:
    """IRI of the cell that contains (x, y) [m]."""
    return f"{CELL}{math.floor(x / SIDE)}_{math.floor(y / SIDE)}"


def cells_of_box(xmin: float, xmax: float, ymin: float, ymax: float) -> tuple[str, ...] | None:
    """IRIs of all cells that touch the box [m]; None for more than `MAX_CELLS`."""
    if not all(math.isfinite(side) for side in (xmin, xmax, ymin, ymax)):
        return None
    west, east = math.floor(xmin / SIDE), math.floor(xmax / SIDE)
    south, north = math.floor(ymin / SIDE), math.floor(ymax / SIDE)
    if (east - west + 1) * (north - south + 1) > MAX_CELLS:
        return None
    columns, rows = range(west, east + 1), range(south, north + 1)
    return tuple(f"{CELL}{column}_{row}" for column in columns for row in rows)


def cells_of_disc(x: float, y: float, radius: float) -> tuple[str, ...] | None:
    """IRIs of all cells that touch the bounding box of the disc [m]; None for too many."""
    return cells_of_box(x - radius, x + radius, y - radius, y + radius)


_UNWRITABLE: Final = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
#: the same in UTF-8, and the carriage return, which an XML parser reads as a line feed
_BYTES: Final = re.compile(rb"[\x00-\x08\x0b\x0c\x0d\x0e-\x1f]|\xef\xbf[\xbe\xbf]")


def unwritable(text: str) -> str | None:
    """The first character of `text` that XML does not allow, as U+0001; None without one."""
    match = _UNWRITABLE.search(text)
    return None if match is None else f"U+{ord(match[0]):04X}"


def shown(text: str) -> str:
    """`text` with U+FFFD for each character that XML does not allow."""
    return _UNWRITABLE.sub("\ufffd", text)


def in_xml(body: bytes) -> bytes:
    """A UTF-8 XML document in which all characters are allowed."""
    return _BYTES.sub(lambda match: b"&#13;" if match[0] == b"\r" else "\ufffd".encode(), body)


def is_xml(media_type: str) -> bool:
    """Whether the media type is one of XML."""
    return media_type.endswith(("/xml", "+xml"))


class XmlPieces:
    """`in_xml` for a document in pieces of any length."""

    def __init__(self) -> None:
        self._pending = b""

    def take(self, piece: bytes) -> bytes:
        """The next characters, without an incomplete one at the end."""
        body = self._pending + piece
        # the first bytes of a character of three bytes that may have to be replaced
        cut = next((n for n in (2, 1) if body.endswith(b"\xef\xbf"[:n])), 0)
        body, self._pending = (body[:-cut], body[-cut:]) if cut else (body, b"")
        return in_xml(body)

    def rest(self) -> bytes:
        """The bytes of an incomplete character at the end of the document."""
        rest, self._pending = self._pending, b""
        return rest


_CRS: Final = re.compile(r"\s*(?:<[^<>\s]*>\s+)?(?=POINT|POLYGON)", re.I)
_MAX_LENGTH: Final = 100_000  # characters


def polygon_text(outline: Outline, crs: str | None = None) -> str:
    """WKT of a polygon with the rings `outline` [m]; `crs` is the IRI of a reference system."""
    rings = (
        f"({', '.join(f'{x:.12g} {y:.12g}' for x, y in (*ring, ring[0]))})" for ring in outline
    )
    polygon = f"POLYGON ({', '.join(rings)})"
    return polygon if crs is None else f"<{crs}> {polygon}"


def area_of_polygon(text: str) -> Area:
    """The area of a WKT polygon [m]; raises ValueError, which names the fault."""
    polygon = _geometry(text, "Polygon")
    if polygon is None:
        raise ValueError("no POLYGON ((x y, x y, x y, x y)) in well-known text")
    rings = polygon.exterior, *polygon.interiors
    return area_of([[(x, y) for x, y, *_ in ring.coords] for ring in rings])


def point_of(text: str) -> tuple[float, float] | None:
    """(x, y) [m] of a WKT point, or None."""
    point = _geometry(text, "Point")
    if point is None or point.is_empty or not math.isfinite(point.x + point.y):
        return None
    return float(point.x), float(point.y)


def _geometry(text: str, kind: str) -> shapely.Geometry | None:
    """The geometry of a WKT literal; None if it is invalid or of another kind."""
    crs = _CRS.match(text) if len(text) <= _MAX_LENGTH else None
    if crs is None:
        return None
    import shapely  # takes 20 ms; maps of rectangles do not need it

    try:
        geometry = shapely.from_wkt(text[crs.end() :], on_invalid="fix")
    except shapely.errors.ShapelyError:
        return None
    return geometry if geometry is not None and geometry.geom_type == kind else None
