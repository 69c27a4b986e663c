"""`hereabouts teach MAP thing NAME PICTURES...`: a thing taught by pictures, a mark or both."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from hereabouts.cli.console import note, write_json
from kg.model.errors import ModelError, RecordingError
from kg.model.regular_files import read_bytes

MAX_PICTURES: Final = 20  # of one thing
_MAX_BYTES: Final = 30_000_000  # of one picture


def teach_thing(arguments: argparse.Namespace) -> int:
    """Keep the looks of the pictures under the name in the map's folder."""
    from kg.maps.thing_names import category_of_name, checked_name
    from kg.serving.opening import open_map
    from kg.store.sparql_client import is_url
    from mapping.looks.known_things import KnownThings, taught
    from mapping.looks.object_looks import Looks
    from perception.inference.markers import marker_name

    if is_url(arguments.map):
        raise ModelError(f"teach needs the folder of a map, and {arguments.map} is an address")
    folder = Path(arguments.map)
    with open_map(arguments.map, read_only=True) as semantic_map:
        name = checked_name(arguments.category[0])
        category_of_name(semantic_map.catalogue, name)  # refuses kinds of places
    marker = marker_name(arguments.marker) if arguments.marker else ""
    paths = _pictures(arguments.category[1:], arguments.images)
    if not paths and not marker:
        raise ModelError(f"no pictures of {name!r}: JPEG or PNG files, or --marker, would work")
    known = KnownThings.load(folder)
    pictures = [_read(path) for path in paths]
    for path, picture in zip(paths, pictures, strict=True):
        try:
            Looks.of_pictures([picture])
        except (RecordingError, ModelError) as error:
            raise type(error)(f"{path}: {error}") from error
    thing = taught(name, pictures, marker)
    known = known.with_thing(thing)
    known.save(folder)
    if arguments.json:
        names = [one.name for one in known.things]
        write_json({"thing": name, "pictures": len(paths), "marker": marker, "known": names})
        return 0
    by = " and ".join(filter(None, [f"{len(paths)} pictures" * bool(paths), marker]))
    note(f"{name}: taught by {by}; {len(known.things)} known things in this map")
    return 0


def _pictures(given: list[str], folder: str | None) -> list[Path]:
    """The given files, and those in folders."""
    from perception.sources.folders.image_files import COLOUR_SUFFIXES

    found = list[Path]()
    for path in map(Path, [*given, *filter(None, [folder])]):
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in COLOUR_SUFFIXES)
        if not inside:
            raise RecordingError(f"no images in {path}: .jpg or .png files would work")
        found += inside
    if len(found) > MAX_PICTURES:
        raise ModelError(f"a thing is taught by up to {MAX_PICTURES} pictures, got {len(found)}")
    return found


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, _MAX_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
