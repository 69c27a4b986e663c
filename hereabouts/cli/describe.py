"""Description of a map: its title, licence and frame; and its validation."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import MAP_HELP, declare
from hereabouts.cli.console import counted, note, print_table, write, write_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kg.maps.semantic_map import SemanticMap

_DESCRIBE_OPTIONS = """
MAP
--title TEXT         name of the map
--licence IRI        licence of the map's data
--relative-to OTHER  the other map: a folder or an address
"""

_TRANSFORM = """
--align           estimate the transform from floors and objects
--pose X,Y,Z,DEG  pose of this map's origin in the other map: metres, and degrees about the vertical
"""


def add_describe(parser: argparse.ArgumentParser) -> None:
    declare(parser, _DESCRIBE_OPTIONS)
    declare(parser.add_mutually_exclusive_group(), _TRANSFORM, pose=_pose)
    declare(parser, "--by\n--json")


def describe(arguments: argparse.Namespace) -> int:
    """Print or set a map's title and licence, and its transform to the frame of another map.

    Exports, VoID and DCAT contain title and licence (graph:dataset). Maps of different recordings
    have frames of their own: searches, plans and distances over several maps keep those apart whose
    transform is not known. With --relative-to OTHER and --align or --pose they are one.

    example: hereabouts describe south.map --relative-to north.map --align --by ann
    """
    from kg.serving.opening import open_map

    placed = arguments.align or arguments.pose is not None
    if placed != (arguments.relative_to is not None):
        arguments.usage_error("give --relative-to OTHER with --align or --pose X,Y,Z,DEG")
    described = arguments.title is not None or arguments.licence is not None
    with open_map(arguments.map, read_only=not (placed or described)) as semantic_map:
        if described:
            change = semantic_map.describe(
                title=arguments.title, licence=arguments.licence, by=arguments.by
            )
            note(f"transaction {change.sequence}" if change else "nothing changed")
        if placed:
            _place(semantic_map, arguments)
        _print(semantic_map, as_json=arguments.json)
    return 0


def _place(semantic_map: SemanticMap, arguments: argparse.Namespace) -> None:
    from kg.maps.facts.coordinate_frames import frame_of
    from kg.serving.opening import open_map
    from mapping.alignment.recording_fit import aligned_maps

    with open_map(arguments.relative_to, read_only=True) as other:
        frame = frame_of(other.engine, other.base)
        T = arguments.pose
        if arguments.align:
            T, found = aligned_maps(semantic_map, other)
            note(found)
    change = semantic_map.place_frame(frame, T, by=arguments.by)
    note(f"transaction {change.sequence}" if change else "nothing changed")


def _print(semantic_map: SemanticMap, *, as_json: bool) -> None:
    from kg.maps.facts.coordinate_frames import frame_of, transform_of

    description = asdict(semantic_map.description)
    frame = frame_of(semantic_map.engine, semantic_map.base)
    parent, T = transform_of(semantic_map.engine, frame) or (None, None)
    encoder = _encoder(semantic_map)
    if as_json:
        matrix = None if T is None else T.tolist()
        placed = {"frame": frame, "relative_to": parent, "transform": matrix}
        write_json(description | placed | {"encoder": encoder})
        return
    for name in sorted(description, key=lambda name: name == "iri"):  # the title first
        write(f"{name:13} {description[name] or 'not set'}")
    write(f"frame         {frame}")
    write(f"relative to   {parent or 'no other frame'}")
    if encoder is not None:
        size = f"{encoder['embeddings']} embeddings in {int(encoder['bytes']) / 1000:.0f} kB"
        write(f"encoder       {encoder['name']}, {size}")
    if T is not None:
        x, y, z = T[:3, 3]
        turn = math.degrees(math.atan2(T[1, 0], T[0, 0]))
        write(f"origin there  ({x:.2f}, {y:.2f}, {z:.2f}) m, turned by {turn:.1f} degrees")


def _encoder(semantic_map: SemanticMap) -> dict[str, str | int] | None:
    """The user's encoder that the map was made with, and the size of what is kept of it."""
    from mapping.looks.look_store import ENCODED, kept_looks

    folder = semantic_map.store.path
    kept = None if folder is None else kept_looks(folder / ENCODED)
    if kept is None:
        return None
    found = {"name": kept.name, "checksum": kept.checksum}
    return {**found, "embeddings": len(kept.rows), "bytes": kept.bytes}


def _pose(text: str) -> NDArray[np.float64]:
    import numpy as np

    try:
        x, y, z, degrees = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = degrees = math.nan
    if not all(map(math.isfinite, (x, y, z, degrees))):
        raise argparse.ArgumentTypeError(f"needs X,Y,Z,DEG, e.g. 2.5,0,0,90; got {text!r}")
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


_CHECK_OPTIONS = f"""
[MAP]             {MAP_HELP}
--ontologies DIR  folder of ontologies to check
--json
"""


def add_check(parser: argparse.ArgumentParser) -> None:
    declare(parser, _CHECK_OPTIONS)


def check(arguments: argparse.Namespace) -> int:
    """Validate the ontologies, and a map if one is given, by SHACL and the vocabulary.

    Files in the folder of the map that cannot be read are findings, too, each with what would help.
    Exit code 1 if anything is wrong.

    example: hereabouts check kitchen.map
    """
    from kg.knowledge.ontology.lint import check_map, check_ontologies
    from kg.knowledge.ontology.unused import unused_statements
    from kg.model.resources import ONTOLOGIES
    from kg.rdf.findings import Finding
    from kg.serving.opening import open_map
    from mapping.keepers.kept_files import unreadable_files

    folder = Path(arguments.ontologies) if arguments.ontologies else ONTOLOGIES
    findings = list(check_ontologies(folder))
    if arguments.map is not None:
        with open_map(arguments.map, read_only=True) as semantic_map:
            findings += check_map(semantic_map.engine)
            findings += [
                Finding(str(path), problem) for path, problem in unreadable_files(semantic_map)
            ]
            for recording in semantic_map.recordings():
                if recording.pose_estimate:
                    note(f"{recording.name}: estimated {recording.pose_estimate}")
            for warning in unused_statements(semantic_map.ontology.quads()):
                note(str(warning))
            _note_missing_history(semantic_map)
            if semantic_map.description.licence is None:
                note("no licence: `hereabouts describe MAP --licence IRI` sets one")
    if arguments.json:
        write_json([asdict(finding) for finding in findings])
    elif findings:
        print_table(
            ("severity", "subject", "property", "value", "problem"),
            [(f.severity, f.focus, f.path, f.value, f.message) for f in findings],
        )
    wrong = sum(finding.severity == "violation" for finding in findings)
    warned = f", {counted(len(findings) - wrong, 'warning')}" if wrong < len(findings) else ""
    note(f"{counted(wrong, 'finding')}{warned}")
    return 1 if wrong else 0


def _note_missing_history(semantic_map: SemanticMap) -> None:
    """Warn where a folder has lost its history, as an incomplete copy has."""
    from kg.model.errors import HistoryError

    try:
        _ = semantic_map.history.log
    except HistoryError as error:
        note(f"{error}, without what happened before")
