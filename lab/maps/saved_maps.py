"""Import and export of the thesis author's saved maps: two JSON files.

Objects are a list of ``{id, label, confidence, ndetections, pos: {x, y, z}}``, places a list of
``{xmin, xmax, ymin, ymax, counter, checked, labels, scene_id, beliefs}``. Labels and ids are those
of his networks (``reference_labels.csv``: COCO's 80 objects under the thesis' names, the scenes of
Places205).
"""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.model.regular_files import read_text
from kg.model.transactions import Cause
from kg.store.folder import write_atomically

NU: Final = 3.0  # greatest confidence of an object, eq. 3.1
MAX_VIEWS: Final = 50  # counter of a loaded belief, so that new views still count

T = TypeVar("T")
Entry = dict[str, Any]
Names = dict[str, tuple[int, str]]

_LABELS = Path(__file__).with_name("reference_labels.csv")


@dataclass(frozen=True, slots=True)
class SavedMap:
    """Number of objects and places imported."""

    objects: int
    places: int


def import_saved_maps(
    semantic_map: SemanticMap,
    objects_json: Path | str | None = None,
    places_json: Path | str | None = None,
    *,
    stamp: float | None = None,
) -> SavedMap:
    """Add saved objects and places to the map as one transaction.

    The files hold no times: objects were last seen at `stamp` [s], by default now. Existence is the
    confidence as a share of nu, at most 1. A place never `checked` has no views yet. Each object
    is in the first place whose rectangle contains it.

    If an error is raised, nothing is written: InvalidFactError for a file of another form, or whose
    whole content is in the map already; UnknownCategoryError for an unknown label.
    """
    catalogue = semantic_map.catalogue
    rooms = semantic_map.places()
    taken = {room.iri for room in rooms}
    free = (number for number in count(1) if semantic_map.place_iri(number) not in taken)
    places = tuple(
        _place(entry, semantic_map.place_iri(number), f"place {number}", catalogue)
        for entry, number in zip(_entries(places_json), free, strict=False)
    )
    rooms += places
    last_seen = time.time() if stamp is None else stamp
    objects = tuple(
        _object(entry, semantic_map.new_object_iri(), rooms, last_seen, catalogue)
        for entry in _entries(objects_json)
    )
    _check_not_imported(
        objects_json, map(_key_of_object, objects), map(_key_of_object, semantic_map.objects())
    )
    _check_not_imported(
        places_json, map(_key_of_place, places), map(_key_of_place, semantic_map.places())
    )
    semantic_map.apply(
        MapUpdate(objects=objects, places=places), Cause("import", note="reference maps")
    )
    return SavedMap(len(objects), len(places))


def _key_of_object(record: ObjectRecord) -> tuple[object, ...]:
    return record.category, *(round(float(value), 2) for value in record.p_map)


def _key_of_place(place: PlaceRecord) -> tuple[object, ...]:
    return tuple(round(x, 2) for x in (place.xmin, place.xmax, place.ymin, place.ymax))


def _check_not_imported(
    path: Path | str | None, new: Iterable[object], known: Iterable[object]
) -> None:
    """Raise InvalidFactError if the map holds all of the file already."""
    fresh = set(new)
    if fresh and fresh.issubset(known):
        raise InvalidFactError(f"all of {path} is in this map already; another map would take it")


def export_saved_maps(
    semantic_map: SemanticMap,
    objects_json: Path | str | None = None,
    places_json: Path | str | None = None,
) -> None:
    """Write objects and places in the form that `import_saved_maps` reads.

    A place is written with its bounding rectangle. A category that those networks lack keeps its
    own label, with id -1. Raises GraphError if a file cannot be written.
    """
    names = _network_names(semantic_map.catalogue)
    label = semantic_map.catalogue.label
    if objects_json is not None:
        objects = [_saved_object(record, names, label) for record in semantic_map.objects()]
        write_atomically(Path(objects_json), json.dumps(objects, indent=1) + "\n")
    if places_json is not None:
        places = [_saved_place(record, names, label) for record in semantic_map.places()]
        write_atomically(Path(places_json), json.dumps(places, indent=1) + "\n")


def _object(
    entry: Entry, iri: str, rooms: Sequence[PlaceRecord], last_seen: float, catalogue: Catalogue
) -> ObjectRecord:
    position = _field(entry, "pos", dict)
    x, y, z = (_number(position, axis) for axis in ("x", "y", "z"))
    confidence = _number(entry, "confidence")
    return ObjectRecord(
        iri=iri,
        category=catalogue.find(_field(entry, "label", str), "object").iri,
        p_map=np.array([x, y, z]),
        confidence=confidence,
        existence=min(max(confidence, 0.0) / NU, 1.0),
        observations=_field(entry, "ndetections", int),
        first_seen=last_seen,
        last_seen=last_seen,
        place=next((room.iri for room in rooms if room.area.contains(x, y)), None),
    )


def _place(entry: Entry, iri: str, label: str, catalogue: Catalogue) -> PlaceRecord:
    names, beliefs = _field(entry, "labels", list), _field(entry, "beliefs", list)
    if len(names) != len(beliefs):
        raise InvalidFactError(
            f"{label}: labels and beliefs must be as many, got {len(names)} and {len(beliefs)}"
        )
    by_name = dict(zip(names, beliefs, strict=True))
    xmin, xmax, ymin, ymax = (_number(entry, edge) for edge in ("xmin", "xmax", "ymin", "ymax"))
    views = min(_field(entry, "counter", int), MAX_VIEWS) if entry.get("checked", True) else 0
    shares = {catalogue.find(str(n), "place").iri: _number(by_name, n) for n in by_name}
    return PlaceRecord(iri, label, xmin, xmax, ymin, ymax, views, shares)


def _saved_object(record: ObjectRecord, names: Names, label: Callable[[str], str]) -> Entry:
    number, name = names.get(record.category, (-1, label(record.category)))
    x, y, z = (float(value) for value in record.p_map)
    return {
        "id": number,
        "confidence": record.confidence,
        "label": name,
        "ndetections": record.observations,
        "pos": {"x": x, "y": y, "z": z},
    }


def _saved_place(record: PlaceRecord, names: Names, label: Callable[[str], str]) -> Entry:
    beliefs = sorted(record.beliefs.items(), key=lambda item: (-item[1], item[0]))
    known = [names.get(category, (-1, label(category))) for category, _ in beliefs]
    return {
        "counter": max(record.views, 1),
        "checked": record.views > 0,
        "xmin": record.xmin,
        "xmax": record.xmax,
        "ymin": record.ymin,
        "ymax": record.ymax,
        "labels": [name for _, name in known],
        "scene_id": [number for number, _ in known],
        "beliefs": [belief for _, belief in beliefs],
    }


def _network_names(catalogue: Catalogue) -> Names:
    """Category IRI -> id and label of the author's network."""
    with _LABELS.open(encoding="utf-8", newline="") as lines:
        return {
            catalogue.find(row["label"], row["kind"]).iri: (int(row["id"]), row["label"])
            for row in csv.DictReader(lines)
        }


def _entries(path: Path | str | None) -> list[Entry]:
    if path is None:
        return []
    try:
        entries = json.loads(read_text(Path(path)))
    except (OSError, ValueError, RecursionError) as error:
        raise InvalidFactError(f"cannot read the saved map {path}: {error}") from error
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InvalidFactError(f"{path} is no saved map: it must be a list of objects or places")
    return entries


def _field(entry: Entry, key: str, kind: type[T]) -> T:
    value = entry.get(key)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise InvalidFactError(
            f"a saved map's {key} must be a {kind.__name__}, got {value!r} in {sorted(entry)}"
        )
    return value


def _number(entry: Entry, key: str) -> float:
    value = entry.get(key)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise InvalidFactError(f"a saved map's {key} must be a number, got {value!r}")
    return float(value)
