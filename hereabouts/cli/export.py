"""Write the map as linked data, JSON, GeoJSON, 3D, or for Foxglove, Rerun and RViz.

Linked data has GeoSPARQL geometries; JSON lists rooms with their objects; GeoJSON is in metres;
MCAP is for Foxglove, rrd for Rerun, a ROS 1 bag for RViz; PLY and glTF have the surface of the room
and the boxes of objects, for MeshLab, Open3D and Blender.

example: hereabouts export kitchen.map --format ttl -o kitchen.ttl
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import declare, whole
from hereabouts.cli.console import note
from kg.model.errors import GraphError, QueryParameterError, did_you_mean
from kg.model.extensions import EXPORTERS, extensions, load_extension

if TYPE_CHECKING:
    from hereabouts.display.viewers.scene import Scene, ScenePlan
    from kg.export.plain_documents import Exporter
    from kg.maps.semantic_map import SemanticMap

#: format -> ending of its files; none for JSON, since .json is JSON-LD
_DOCUMENTS: Final = {"geojson": ".geojson", "json": ""}
_SCENES: Final = {"mcap": ".mcap", "rrd": ".rrd", "bag": ".bag"}
_MESHES: Final = {"ply": ".ply", "gltf": ".glb"}


_OPTIONS = """
MAP
--format FORMAT      ttl, trig, nq, nt, jsonld or rdfxml; json, geojson; ply, gltf; mcap, rrd, bag
                     (default: by the ending of FILE; .json is JSON-LD); or the exporter
                     of an extension, by its name
-o, --output FILE    file to write
--at
--no-ontology        write the map's facts without the ontology
--all                json, geojson, ply, gltf, mcap, rrd, bag: objects of any existence, not only
                     0.5 and above
--find OBJECT        mcap, rrd, bag: add the search plan for this object
--from
--past N             mcap, rrd, bag: add N moments of the map's past
--pictures FOLDER    copy the pictures of the objects into this folder (object/17: 17.jpg)
--features FILE.npz  write the embeddings of the objects' views by the map's encoder, as arrays iri
                     (n,) and embedding (n, D); no other export has them
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, output={"required": True}, past=whole)


def run(arguments: argparse.Namespace) -> int:
    from kg.export.serialization import export_map, keeps_graphs
    from kg.serving.opening import open_map

    output = Path(arguments.output)
    chosen = _chosen_format(arguments.format, output)
    if arguments.find is not None and chosen not in _SCENES:
        raise QueryParameterError(f"--find needs one of the formats {', '.join(_SCENES)}")
    if arguments.past is not None and (chosen not in _SCENES or arguments.at is not None):
        raise QueryParameterError(
            f"--past needs one of the formats {', '.join(_SCENES)}, and no --at"
        )
    if arguments.features is not None and Path(arguments.features).suffix != ".npz":
        raise QueryParameterError(
            "--features writes numpy's arrays; a name such as looks.npz would"
        )
    with ExitStack() as stack:
        semantic_map = stack.enter_context(open_map(arguments.map, read_only=True))
        if arguments.at is not None:
            semantic_map = stack.enter_context(semantic_map.at(arguments.at))
        _write_beside(semantic_map, arguments)
        if chosen in _DOCUMENTS:
            note(f"wrote {output}: {_write_document(semantic_map, output, chosen, arguments)}")
        elif chosen in extensions(EXPORTERS):
            note(f"wrote {output}: {_exporter(chosen).write(semantic_map, output)}")
        elif chosen in _MESHES:
            note(f"wrote {output}: {_write_mesh(semantic_map, output, chosen, arguments)}")
        elif chosen in _SCENES:
            note(f"wrote {output}: {_write_scene(semantic_map, output, chosen, arguments)}")
        else:
            with_ontology = not arguments.no_ontology
            count = export_map(semantic_map, output, format=chosen, ontology=with_ontology)
            unit = "quads" if keeps_graphs(chosen) else "triples"
            note(f"wrote {output}: {count:,} {unit}")
    return 0


def _write_beside(semantic_map: SemanticMap, arguments: argparse.Namespace) -> None:
    """Write the pictures and embeddings that are asked for."""
    if arguments.pictures is not None:
        folder = Path(arguments.pictures)
        count = _copy_pictures(semantic_map, folder, _min_existence(arguments))
        note(f"wrote {folder}: {count} pictures")
    if arguments.features is not None:
        count = _write_features(semantic_map, Path(arguments.features), arguments)
        note(f"wrote {arguments.features}: {count} embeddings")


def _write_features(semantic_map: SemanticMap, output: Path, arguments: argparse.Namespace) -> int:
    """Write the embeddings of objects and things without a name; returns their number."""
    import numpy as np

    from mapping.looks.look_store import kept_embeddings
    from perception.inference.array_file import write_arrays

    if semantic_map.store.path is None:
        raise QueryParameterError("--features needs the folder of a map as MAP")
    records = semantic_map.objects(min_existence=_min_existence(arguments))
    iris = [one.iri for one in (*records, *semantic_map.unnamed_things())]
    kept, found = kept_embeddings(semantic_map.store.path, iris)
    rows = [row for views in found.values() for row in views]
    arrays = {
        "encoder": np.array(kept.name),
        "checksum": np.array(kept.checksum),
        "iri": np.array([iri for iri, views in found.items() for _ in views], dtype=np.str_),
        "embedding": np.array(rows, np.float16),
    }
    write_arrays(output, arrays)
    return len(rows)


def _copy_pictures(semantic_map: SemanticMap, folder: Path, min_existence: float) -> int:
    """Copy the pictures of objects of existence `min_existence` and above; returns their number."""
    from kg.maps.object_pictures import ObjectPictures
    from kg.store.folder import write_atomically

    if semantic_map.store.path is None:
        raise QueryParameterError("--pictures needs the folder of a map as MAP")
    _make(folder)
    pictures = ObjectPictures(semantic_map.store.path)
    records = semantic_map.objects(min_existence=min_existence)
    found = {one.iri: pictures.path_of(one) for one in records}
    kept = {iri.rpartition("/")[2]: path for iri, path in found.items() if path is not None}
    for number, path in kept.items():
        write_atomically(folder / f"{number}.jpg", path.read_bytes())
    return len(kept)


def _chosen_format(given: str | None, output: Path) -> str:
    """The format of `--format`, or of the file's ending; raises GraphError for neither."""
    from kg.export.serialization import FORMATS, is_format

    names = (*FORMATS, *_DOCUMENTS, *_MESHES, *_SCENES, *extensions(EXPORTERS))
    if given is not None:
        if given not in names and not is_format(given):
            raise GraphError(
                f"no export format {given!r}; there are: {', '.join(names)}"
                f"{did_you_mean(given, names)}"
            )
        return given
    endings = {ending: name for name, endings in FORMATS.items() for ending in endings}
    endings |= {ending: name for name, ending in (_DOCUMENTS | _MESHES | _SCENES).items() if ending}
    if output.suffix.lower() not in endings:
        endings |= {_exporter(name).ending: name for name in extensions(EXPORTERS)}
    if (chosen := endings.get(output.suffix.lower())) is None:
        raise GraphError(
            f"cannot tell the format of {output.name!r} from its ending; give --format "
            f"({', '.join(names)}), or one of the endings {', '.join(endings)}"
        )
    return chosen


def _exporter(name: str) -> Exporter:
    from kg.export.plain_documents import Exporter

    return load_extension(EXPORTERS, name, Exporter)


def _min_existence(arguments: argparse.Namespace) -> float:
    """Minimum existence of exported objects."""
    from hereabouts.display.plots.drawing import SHOWN_EXISTENCE

    return 0.0 if arguments.all else SHOWN_EXISTENCE


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GraphError(f"cannot make the folder {folder}: {error.strerror}") from error


def _write_document(
    semantic_map: SemanticMap, output: Path, chosen: str, arguments: argparse.Namespace
) -> str:
    from kg.export.plain_documents import geojson_document, rooms_document
    from kg.store.folder import write_atomically

    min_existence = _min_existence(arguments)
    make = geojson_document if chosen == "geojson" else rooms_document
    document = make(semantic_map, min_existence)
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1)
    write_atomically(output, text + "\n")
    if chosen == "geojson":
        return f"{len(document['features'])} features, in metres of the map frame"
    return f"{len(document['rooms'])} rooms"


def _write_mesh(
    semantic_map: SemanticMap, output: Path, chosen: str, arguments: argparse.Namespace
) -> str:
    from hereabouts.display.viewers.mesh_files import scene_as_glb, scene_as_ply
    from hereabouts.display.viewers.scene import present_scene
    from kg.store.folder import write_atomically

    scene, _ = present_scene(semantic_map, _min_existence(arguments))
    write_atomically(output, (scene_as_ply if chosen == "ply" else scene_as_glb)(scene))
    return f"{len(scene.surface):,} voxels, {len(scene.objects)} objects"


def _write_scene(
    semantic_map: SemanticMap, output: Path, chosen: str, arguments: argparse.Namespace
) -> str:
    from hereabouts.display.viewers.scene import past_scenes, present_scene
    from kg.store.folder import write_atomically

    make = _scene_writer(chosen)
    plan = None if arguments.find is None else _plan(semantic_map, arguments)
    min_existence = _min_existence(arguments)
    scene, stamp = present_scene(semantic_map, min_existence, plan)
    past = past_scenes(semantic_map, arguments.past, min_existence) if arguments.past else ()
    write_atomically(output, make(chain(past, [(scene, stamp)])))
    return f"{len(scene.objects)} objects, {len(scene.places)} places"


def _scene_writer(chosen: str) -> Callable[[Iterable[tuple[Scene, float]]], bytes]:
    from hereabouts.display.viewers.viewer import require

    if chosen == "mcap":
        require("foxglove", "foxglove")
        from hereabouts.display.viewers.foxglove_viewer import scenes_as_mcap

        return scenes_as_mcap
    if chosen == "rrd":
        require("rerun", "rerun")
        from hereabouts.display.viewers.rerun_viewer import scenes_as_rrd

        return scenes_as_rrd
    require("rosbags", "ros")
    from hereabouts.display.viewers.ros_messages import scenes_as_bag

    return scenes_as_bag


def _plan(semantic_map: SemanticMap, arguments: argparse.Namespace) -> ScenePlan | None:
    """The looks that `find --picture` would draw."""
    from hereabouts.display.viewers.scene import planned_search

    plan = planned_search(semantic_map, arguments.find, arguments.start)
    if plan is None:
        note(f"no search for {arguments.find} is drawn: the map has no floor to search")
    return plan
