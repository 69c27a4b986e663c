"""Teach the kind of a room by images of it, or a thing by pictures.

The images are frames of a mapped recording that were taken in the place, or a folder of
photographs. They are kept in the map's folder; `hereabouts map` uses them once two kinds of rooms
are taught. Teaching a place again replaces its images.

With the word `thing` in place of PLACE follow a name and pictures that show the thing from several
sides, each filled by it: `hereabouts teach home.map thing "my mug" mug-1.jpg mug-2.jpg`. The next
recordings of the map name an object that looks like it. A mark on the thing (--marker) names it for
certain.

example: hereabouts teach home.map place/2 kitchen --images photographs/kitchen
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, write_json
from hereabouts.cli.mapping_options import Networks
from hereabouts.cli.recording_options import add_recording_arguments, recording_options
from kg.model.errors import LayoutError, ModelError, RecordingError, UnknownCategoryError
from kg.model.regular_files import read_bytes

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kg.maps.semantic_map import SemanticMap
    from kg.model.records import PlaceRecord
    from perception.inference.scene_classifier import OnnxSceneClassifier

Item = TypeVar("Item")

_MAX_IMAGES: Final = 40  # images of a place from a recording or a folder, evenly spaced


_OPTIONS = """
MAP
PLACE         place/2, its label or IRI; or: thing
CATEGORY ...  kind of room: kitchen, home office, ...; of a thing its name, and pictures
"""

_SOURCE = """
--recording DIR  recording in the map; its frames in the place count
--images DIR     folder of images of the place
"""

_HOW = """
--scene NAME|FILE  scene classifier with an output `features` (default: the bundled one)
--marker MARK      ArUco or AprilTag on the thing, as in 4x4_50/17
--device
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)
    declare(parser.add_mutually_exclusive_group(), _SOURCE)
    declare(parser, _HOW, scene={"default": "default"})
    add_recording_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    from kg.store.folder import is_url

    if is_url(arguments.map):
        raise ModelError(f"teach needs the folder of a map, and {arguments.map} is an address")
    if arguments.place == "thing":
        return teach_thing(arguments)
    if not (arguments.recording or arguments.images):
        arguments.usage_error("images are missing: --recording DIR or --images DIR")
    if arguments.marker:
        arguments.usage_error("--marker is for a thing, as in: teach MAP thing 'my mug' --marker M")
    return _teach_room(arguments)


def _teach_room(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from perception.inference.scene_classifier import (
        RoomExamples,
        load_scene_classifier,
        room_examples,
    )
    from perception.sources.folders.image_files import read_colour

    folder = Path(arguments.map)
    network = load_scene_classifier(arguments.scene, device=arguments.device)
    with open_map(arguments.map, read_only=True) as semantic_map:
        place = _place(semantic_map, arguments.place)
        label = _label(semantic_map, " ".join(arguments.category), network)
        images = _frames_in(semantic_map, place, arguments) if arguments.recording else None
        if images is None:
            images = map(read_colour, _spaced(_images_in(Path(arguments.images))))
        taught = room_examples(network, images, label=label, place=place.iri)
    before = RoomExamples.load(folder)
    examples = taught if before is None else before.with_place(taught)
    examples.save(folder)
    kinds = {kind: examples.label.count(kind) for kind in dict.fromkeys(examples.label)}
    if arguments.json:
        found = {"place": place.iri, "category": label, "images": len(taught.label)}
        write_json(found | {"taught": kinds, "network": network.name})
        return 0
    listed = ", ".join(f"{kind} ({number})" for kind, number in kinds.items())
    name = place.label or place.iri
    note(f"{name}: {len(taught.label)} images of {label}; taught so far: {listed}")
    if len(kinds) < 2:
        note("one kind of room has no effect: teach a second kind, so that both can be told apart")
    return 0


def with_taught_rooms(networks: Networks, address: str) -> Networks:
    """`networks`, whose scene classifier knows the rooms that the map at `address` was taught."""
    from perception.inference.scene_classifier import (
        OnnxSceneClassifier,
        RoomExamples,
        TaughtSceneClassifier,
    )

    scene = networks.scene
    if not isinstance(scene, OnnxSceneClassifier):
        return networks
    examples = RoomExamples.load(Path(address))
    if examples is None or len(set(examples.label)) < 2:
        return networks
    note(f"rooms taught in this map: {', '.join(dict.fromkeys(examples.label))}")
    return replace(networks, scene=TaughtSceneClassifier(scene, examples))


def _place(semantic_map: SemanticMap, name: str) -> PlaceRecord:
    """The place of that short name, label or IRI."""
    places = semantic_map.places()
    short = {place.iri.removeprefix(semantic_map.base): place for place in places}
    for found in (short.get(name), *(p for p in places if name in (p.iri, p.label))):
        if found is not None:
            return found
    some = ", ".join(list(short)[:8]) or "none yet (hereabouts rooms MAP find)"
    raise LayoutError(f"no place {name!r} in this map; there are: {some}")


def _label(semantic_map: SemanticMap, name: str, network: OnnxSceneClassifier) -> str:
    """The network's label of a category, else the ontology's."""
    catalogue = semantic_map.catalogue
    category = catalogue.for_label(name, "place")
    if category is None:
        raise UnknownCategoryError(
            f"no kind of place {name!r}; `hereabouts ontology` lists them, such as kitchen, office"
        )
    for label in network.labels:
        same = catalogue.for_label(label, "place")
        if same is not None and same.iri == category.iri:
            return label
    return category.label


def _frames_in(
    semantic_map: SemanticMap, place: PlaceRecord, arguments: argparse.Namespace
) -> Iterator[NDArray[np.uint8]]:
    """Images of the recording's frames that were taken in the place."""
    from mapping.runs.resumption import resumed
    from perception.sources.recording import open_recording

    recording = open_recording(
        arguments.recording, recording_options(arguments, arguments.recording)
    )
    if recording.name not in {record.name for record in semantic_map.recordings()}:
        raise LayoutError(f"{recording.name!r} is not in this map; map it first, or give --images")
    poses = (
        (index, frame.T_map_cam[:2, 3], frame)
        for index, frame in enumerate(resumed(recording, semantic_map).frames())
    )
    inside = [index for index, (x, y), _ in poses if place.area.contains(float(x), float(y))]
    if not inside:
        raise LayoutError(f"no frame of {recording.name} was taken in {place.label or place.iri}")
    chosen = set(_spaced(inside))
    frames = resumed(recording, semantic_map).frames()
    return (frame.rgb for index, frame in enumerate(frames) if index in chosen)


def _images_in(folder: Path) -> list[Path]:
    """The photographs of a folder, by name; raises RecordingError for none."""
    from perception.sources.folders.image_files import COLOUR_SUFFIXES

    try:
        found = sorted(p for p in folder.iterdir() if p.suffix.lower() in COLOUR_SUFFIXES)
    except OSError as error:
        raise RecordingError(f"cannot read {folder}: {error.strerror}") from error
    if not found:
        raise RecordingError(f"no images in {folder}: .jpg or .png files would work")
    return found


def _spaced(items: list[Item]) -> list[Item]:
    """At most _MAX_IMAGES of them, evenly spaced."""
    step = max(len(items) / _MAX_IMAGES, 1.0)
    return [items[int(i * step)] for i in range(min(len(items), _MAX_IMAGES))]


MAX_PICTURES: Final = 20  # of one thing
_MAX_BYTES: Final = 30_000_000  # of one picture


def teach_thing(arguments: argparse.Namespace) -> int:
    """Keep the looks of the pictures under the name in the map's folder."""
    from kg.maps.thing_names import category_of_name, checked_name
    from kg.serving.opening import open_map
    from mapping.looks.known_things import KnownThings, taught
    from mapping.looks.word_looks import network
    from perception.inference.markers import marker_name

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
            network().describe(picture)
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
    found = list[Path]()
    for path in map(Path, [*given, *filter(None, [folder])]):
        found += _images_in(path) if path.is_dir() else [path]
    if len(found) > MAX_PICTURES:
        raise ModelError(f"a thing is taught by up to {MAX_PICTURES} pictures, got {len(found)}")
    return found


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, _MAX_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
