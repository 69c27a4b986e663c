"""Maps as plain documents for programs without RDF: rooms with their objects, and GeoJSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Ring
from kg.model.iris import whole_number
from kg.model.records import DepartedRecord, ObjectRecord, PlaceRecord
from kg.rdf.standard_terms import CRS

_FRAME = "local frame of this map: metres, z up, the floor about z = 0; not geographic"


def rooms_document(semantic_map: SemanticMap, min_existence: float = 0.5) -> dict[str, Any]:
    """JSON of places with their objects of existence `min_existence` or above.

    Objects in no place are under "elsewhere", departed objects under "departed"; times are [s]
    since 1970.
    """
    names = _Names(semantic_map)
    held: dict[str | None, list[dict[str, Any]]] = {}
    places = semantic_map.places()
    known = {place.iri for place in places}
    for record in _shown(semantic_map, min_existence):
        place = record.place if record.place in known else None
        held.setdefault(place, []).append(names.object(record))
    robot = semantic_map.robot()
    return {
        "map": semantic_map.base,
        "title": semantic_map.description.title,
        "frame": _FRAME,
        "rooms": [
            {
                **names.place(place),
                "outline": [[list(corner) for corner in ring] for ring in place.area.rings],
                "viewed_share": 0.0 if place.viewed is None else round(place.viewed.share, 4),
                "adjacent": [names.short(iri) for iri in place.adjacent],
                "objects": held.get(place.iri, []),
            }
            for place in places
        ],
        "elsewhere": held.get(None, []),
        "departed": [names.departed(record) for record in semantic_map.departed()],
        "robot": robot
        and {
            "position": [round(float(c), 3) for c in robot.p_map],
            "heading": round(robot.heading, 4),
            "stamp": robot.stamp,
        },
    }


def geojson_document(semantic_map: SemanticMap, min_existence: float = 0.5) -> dict[str, Any]:
    """GeoJSON of places (Polygon) and objects (Point) of existence `min_existence` or above.

    The property "footprint" has the corners of an object's box.

    RFC 7946 has longitude and latitude, and other systems by prior arrangement (section 4). "crs"
    is a foreign member (section 6.1) in the form of earlier GeoJSON, so that readers such as GDAL
    do not read metres as degrees.
    """
    names = _Names(semantic_map)
    features = [
        _feature(
            names.number(place.iri),
            {"type": "Polygon", "coordinates": list(map(_closed, place.area.oriented_rings))},
            {"kind": "place", **names.place(place)},
        )
        for place in semantic_map.places()
    ]
    for record in _shown(semantic_map, min_existence):
        fields = {"kind": "object", **names.object(record), "footprint": _footprint(record)}
        features.append(
            _feature(None, {"type": "Point", "coordinates": fields.pop("position")}, fields)
        )
    return {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": semantic_map.base + CRS}},
        "name": semantic_map.description.title,
        "frame": _FRAME,
        "features": features,
    }


class _Names:
    """Short names and labels of a map's things."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._base, self._catalogue = semantic_map.base, semantic_map.catalogue

    def short(self, iri: str) -> str:
        return iri.removeprefix(self._base)

    def number(self, iri: str) -> int | None:
        """The number of place/7; None for places with other IRIs."""
        return whole_number(self.short(iri).removeprefix("place/"))

    def place(self, place: PlaceRecord) -> dict[str, Any]:
        beliefs = self._shares(place.beliefs)
        return {
            "name": self.short(place.iri),
            "label": place.label,
            "likely_category": next(iter(beliefs), None) if place.views else None,
            "beliefs": beliefs if place.views else {},
        }

    def object(self, record: ObjectRecord) -> dict[str, Any]:
        size, deviation, seen = record.extent, record.deviation, record.evidence
        return {
            "name": self.short(record.iri),
            "category": self._catalogue.label(record.category),
            "position": [round(float(c), 3) for c in record.p_map],
            "size": None if size is None else [_finite(c) for c in size],
            "yaw": _finite(record.yaw),
            "deviation": None if deviation is None else _finite(deviation),
            "existence": round(record.existence, 4),
            "may_be": self._shares(record.labels),
            "observations": record.observations,
            "last_seen": record.last_seen,
            "seen_in": None
            if seen is None
            else {
                "recording": seen.recording,
                "frame": seen.frame,
                "box": [round(value) for value in seen.box],
            },
            "place": None if record.place is None else self.short(record.place),
            "relations": [
                {
                    "kind": relation.kind,
                    "target": self.short(relation.target),
                    "probability": round(relation.probability, 4),
                }
                for relation in record.relations or ()
            ],
        }

    def _shares(self, shares: Mapping[str, float]) -> dict[str, float]:
        """Labels of categories with their probabilities, the most probable one first."""
        ordered = sorted(shares.items(), key=lambda item: (-item[1], item[0]))
        return {self._catalogue.label(iri): round(share, 4) for iri, share in ordered}

    def departed(self, record: DepartedRecord) -> dict[str, Any]:
        return {
            "name": self.short(record.iri),
            "category": self._catalogue.label(record.category),
            "position": [_finite(c) for c in record.p_map],
            "last_seen": record.last_seen,
            "found_gone": record.found_gone,
        }


def _shown(semantic_map: SemanticMap, min_existence: float) -> Iterable[ObjectRecord]:
    return (
        record
        for record in semantic_map.objects()
        if record.existence >= min_existence and all(math.isfinite(c) for c in record.p_map)
    )


def _feature(
    number: int | None, geometry: dict[str, Any], properties: dict[str, Any]
) -> dict[str, Any]:
    own = {} if number is None else {"id": number}
    return {"type": "Feature", **own, "geometry": geometry, "properties": properties}


def _closed(ring: Ring) -> list[list[float]]:
    """A linear ring, whose last corner is its first."""
    return [[float(x), float(y)] for x, y in (*ring, ring[0])]


def _footprint(record: ObjectRecord) -> list[list[float]] | None:
    """Corners [m] of an object's box from above, without the first again."""
    corners = record.footprint
    if corners is None or not np.isfinite(corners).all():
        return None
    return [[round(float(x), 3), round(float(y), 3)] for x, y in corners]


def _finite(value: float) -> float | None:
    return round(float(value), 3) if math.isfinite(value) else None


@dataclass(frozen=True, slots=True)
class Exporter:
    """An export format; its name is that of its entry point in `hereabouts.exporters`."""

    ending: str  # of its files, such as ".csv"
    write: Callable[[SemanticMap, Path], str]  # writes the file; returns a summary for people
