"""GeoSPARQL features and geometries of a map, derived when it is exported or dereferenced.

GeoSPARQL takes a literal without a coordinate reference system to be longitude and latitude, so
each names the map's own: metres in a local frame with z up.
"""

from __future__ import annotations

from collections.abc import Iterator

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.records import ObjectRecord, PlaceRecord, RobotRecord
from kg.rdf.wkt import polygon_text

GEOMETRY = "/geometry"  # behind the IRI of a feature
CRS = "crs"  # behind the IRI of the map


def geometry_quads(
    base: str,
    objects: tuple[ObjectRecord, ...],
    places: tuple[PlaceRecord, ...],
    robot: RobotRecord | None,
) -> Iterator[Quad]:
    """geo:Feature, geo:hasGeometry and geo:asWKT of each record, and the reference system."""
    crs = NamedNode(base + CRS)
    yield from crs_quads(base)
    for record in objects:
        yield from _geometry(record.iri, f"{crs} {_point(record.p_map)}")
    for place in places:
        yield from _geometry(place.iri, polygon_text(place.area.rings, crs.value))
    if robot is not None:
        yield from _geometry(base + "robot", f"{crs} {_point(robot.p_map)}")


def crs_quads(base: str) -> Iterator[Quad]:
    """The coordinate reference system of the map with IRI `base`."""
    crs = NamedNode(base + CRS)
    comment = "Local frame of this map: metres, z up, the floor about z = 0; not geographic."
    yield Quad(crs, NamedNode(v.RDFS_LABEL), Literal("map frame"), v.MAP_GRAPH)
    yield Quad(crs, NamedNode(v.RDFS_COMMENT), Literal(comment), v.MAP_GRAPH)


def _geometry(iri: str, wkt: str) -> Iterator[Quad]:
    geometry = NamedNode(iri + GEOMETRY)
    yield Quad(NamedNode(iri), v.RDF_TYPE, NamedNode(v.GEO_FEATURE), v.MAP_GRAPH)
    yield Quad(NamedNode(iri), NamedNode(v.GEO_HAS_GEOMETRY), geometry, v.MAP_GRAPH)
    yield Quad(geometry, v.RDF_TYPE, NamedNode(v.GEO_GEOMETRY), v.MAP_GRAPH)
    yield Quad(
        geometry, NamedNode(v.GEO_AS_WKT), Literal(wkt, datatype=v.GEO_WKT_LITERAL), v.MAP_GRAPH
    )


def _point(p_map: object) -> str:
    x, y, z = (f"{float(value):.12g}" for value in p_map)  # type: ignore[attr-defined]
    return f"POINT Z ({x} {y} {z})"
