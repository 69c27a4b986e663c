"""Map a recording: RGB-D frames with poses in, objects and places out.

The map may be new or exist already. A run that was interrupted continues after its last frame.

example: hereabouts map recordings/kitchen --into kitchen.map
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import (
    MAP_HELP,
    add_viewers,
    declare,
    keep_seconds,
    open_viewers,
    title_for,
)
from hereabouts.cli.console import note, print_table, progress, write_json
from hereabouts.cli.mapping_options import Inputs, add_all_arguments, open_inputs
from hereabouts.cli.name import note_unnamed
from hereabouts.cli.teach import with_taught_rooms
from kg.model.errors import GraphError, LayoutError, MapNotFoundError, RecordingError

if TYPE_CHECKING:
    from hereabouts.cli.mapping_options import Networks
    from hereabouts.display.viewers.viewer import Viewer
    from kg.maps.semantic_map import SemanticMap
    from mapping.labels.label_resolver import LabelTable
    from mapping.mapping_options import MappingOptions
    from mapping.recording_mapper import OnDetections
    from mapping.runs.progress_report import FrameReport, MappingReport
    from perception.frames import Detections, Frame, Recording, SceneScores

_MAX_NAMED = 10  # labels in one note
_BETTER = "deimv2_femto_coco"  # detector that names more than the bundled ones, ...
_BETTER_BY = (
    "names 16 of the 23 things of a real kitchen, the bundled detectors 12"  # ... and by what
)
_TELL_EVERY = 10.0  # [s] between two lines on the progress where stderr is no terminal


_OPTIONS = """
RECORDING  folder of the recording
--again    map frames again that are in this map already
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)
    add_map_options(parser)
    add_all_arguments(parser)


_INTO = f"""
--into MAP      {MAP_HELP}
--pictures DIR  save frames with boxes and scene scores
"""
_WRITING = """
--base IRI       base IRI of a new map (default: a unique one)
--power-safe     wait for the disk at each frame, so that a power cut loses nothing
--keep DURATION  length of the history to keep: 30d, 12h, 90m, 2w or 1y (default: all of the past;
                 the rest is dropped while mapping)
--json
"""


def add_map_options(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `open_for_mapping` and `print_outcome` read."""
    declare(parser, _INTO, into={"required": True})
    add_viewers(parser)
    declare(parser, _WRITING)


def run(arguments: argparse.Namespace) -> int:
    inputs = open_inputs(arguments, arguments.recording)
    with (
        open_viewers(arguments, title_for(arguments.into)) as viewer,
        open_for_mapping(arguments, inputs.options, viewer) as (semantic_map, on_detections),
    ):
        if inputs.corrected and _correct_poses(inputs, semantic_map, arguments):
            return 0
        inputs = fitted(inputs, semantic_map, arguments.into)
        report = map_frames(
            inputs.recording,
            semantic_map,
            inputs.networks,
            inputs.options,
            on_detections=on_detections,
            again=arguments.again,
        )
        if report.frames == 0:
            note(
                f"all {report.skipped} frames are already in this map; --again maps them once more"
            )
        print_outcome(semantic_map, report, arguments, inputs.networks.device)
    return 0


@contextmanager
def open_for_mapping(
    arguments: argparse.Namespace, options: MappingOptions, viewer: Viewer | None
) -> Iterator[tuple[SemanticMap, OnDetections | None]]:
    """The map to write into, and a callback for each mapped frame, which also feeds `viewer`."""
    from kg.model.platforms import gc_frozen
    from kg.serving.opening import open_or_create_map

    keep = keep_seconds(arguments)
    if options.labels.names:
        _check_categories(options.labels, arguments.into)
    save = _picture_saver(Path(arguments.pictures)) if arguments.pictures else None
    with (
        open_or_create_map(
            arguments.into,
            title=title_for(arguments.into),
            base=arguments.base,
            power_safe=arguments.power_safe,
        ) as semantic_map,
        _watched(semantic_map, viewer, save) as on_detections,
    ):
        _check_base(semantic_map, arguments)
        if keep is not None:
            semantic_map.history.retain(keep)
        with gc_frozen():
            yield semantic_map, on_detections


def _check_base(semantic_map: SemanticMap, arguments: argparse.Namespace) -> None:
    """Raise GraphError where `--base` is not the base of the map that exists already."""
    given = arguments.base
    if given is not None and semantic_map.base not in (given, f"{given}/"):
        raise GraphError(
            f"{arguments.into} has the base {semantic_map.base}; --base is for a new map"
        )


def _correct_poses(
    inputs: Inputs, semantic_map: SemanticMap, arguments: argparse.Namespace
) -> bool:
    """Move the recording's part of the map to its corrected poses; False if it is not mapped."""
    from mapping.alignment.pose_correction import correct_poses, is_mapped
    from perception.sources.recording import open_recording

    if not is_mapped(inputs.recording, semantic_map):
        return False
    as_mapped = replace(inputs.reading, poses=None, check=False)
    options = replace(inputs.options, find_places=False)
    previous = open_recording(inputs.path, as_mapped)
    if previous.estimate is not None:
        raise LayoutError(
            f"{inputs.recording.name!r} was mapped by estimated poses, in a world of its own; "
            f"a new map would work: --into another map with --poses {inputs.reading.poses}"
        )
    report = correct_poses(
        inputs.recording,
        previous,
        semantic_map,
        lambda recording, apart: map_frames(recording, apart, inputs.networks, options),
        inputs.options,
    )
    if arguments.json:
        write_json(report.to_json())
        return True
    summary = semantic_map.query("summary")
    print_table(summary.columns, summary.rows)
    note(report.summary())
    return True


def check_unmapped(inputs: Inputs, semantic_map: SemanticMap) -> None:
    """Raise LayoutError for corrected poses of a recording that is in the map already."""
    from mapping.alignment.pose_correction import is_mapped

    if is_mapped(inputs.recording, semantic_map):
        raise LayoutError(
            f"{inputs.recording.name!r} is in this map already; "
            "`hereabouts map ... --into MAP --poses FILE` moves it to its corrected poses"
        )


def fitted(inputs: Inputs, semantic_map: SemanticMap, address: str) -> Inputs:
    """Inputs for the map at `address`, with its taught rooms; aligned if --align is given."""
    inputs = replace(inputs, networks=with_taught_rooms(inputs.networks, address))
    if not inputs.align:
        return inputs
    from mapping.alignment.recording_fit import aligned

    recording, report = aligned(
        inputs.recording, semantic_map, inputs.networks.detector, labels=inputs.options.labels
    )
    if report:
        note(report)
        rows = " ".join(f"{x:.6g}" for x in recording.T_map_world.ravel())
        note(f"T_map_world, row by row: {rows}")
    return replace(inputs, recording=recording)


def map_frames(
    recording: Recording,
    semantic_map: SemanticMap,
    networks: Networks,
    options: MappingOptions,
    *,
    on_detections: OnDetections | None = None,
    again: bool = False,
    lost: Callable[[], str] | None = None,
) -> MappingReport:
    """Run the mapping pipeline under a progress bar; `lost` tells the number of dropped frames."""
    from mapping.frames.read_ahead import AHEAD
    from mapping.recording_mapper import map_recording

    with progress() as bar:
        total = len(recording) if lost is None else None
        task = bar.add_task(recording.name, total=total, status="")
        told = time.monotonic()

        def on_frame(report: FrameReport) -> None:
            nonlocal told
            rate = report.frames_per_second
            if bar.disable and time.monotonic() - told >= _TELL_EVERY:  # no terminal for a bar
                told = time.monotonic()
                of = "" if total is None else f" of {total}"
                note(f"{report.index + 1}{of} frames, {report.objects} objects")
            bar.update(
                task,
                completed=report.index + 1,
                status=f"{rate:4.1f} frames/s  {report.objects} objects"
                + ("" if lost is None else f"  {lost()}"),
            )

        return map_recording(
            recording,
            semantic_map,
            networks.detector,
            networks.scene,
            options,
            again=again,
            on_frame=on_frame,
            on_detections=on_detections,
            ahead=AHEAD if lost is None else 1,
        )


def _check_categories(labels: LabelTable, address: str) -> None:
    """Check a labels map before its map is made or opened for writing; raises LabelsError."""
    from kg.knowledge.ontology.catalogue import Catalogue
    from kg.knowledge.ontology.loading import load_ontologies
    from kg.serving.opening import open_map

    try:
        with open_map(address, read_only=True) as semantic_map:
            catalogue = semantic_map.catalogue
    except MapNotFoundError:
        catalogue = Catalogue.from_quads(load_ontologies().quads)
    labels.check_categories(catalogue)


@contextmanager
def _watched(
    semantic_map: SemanticMap, viewer: Viewer | None, save: OnDetections | None
) -> Iterator[OnDetections | None]:
    """A callback for each mapped frame that saves pictures and feeds a viewer."""
    if viewer is None:
        yield save
        return
    from hereabouts.display.viewers.feed import MappingFeed

    feed = MappingFeed(semantic_map, viewer)

    def on_detections(frame: Frame, detections: Detections, scene: SceneScores | None) -> None:
        if save is not None:
            save(frame, detections, scene)
        feed.on_detections(frame, detections, scene)

    yield on_detections
    feed.show()


def _picture_saver(folder: Path) -> OnDetections:
    from perception.annotate import draw_detections, save_image

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"cannot make the folder {folder}: {error.strerror}") from error

    def save(frame: Frame, detections: Detections, scene: SceneScores | None) -> None:
        save_image(folder / f"{frame.id}.jpg", draw_detections(frame, detections, scene))

    return save


def print_outcome(
    semantic_map: SemanticMap,
    report: MappingReport,
    arguments: argparse.Namespace,
    device: str,
    more: Mapping[str, object] | None = None,
) -> None:
    """Print the outcome; `more` is for `--json`."""
    if arguments.json:
        write_json({**report.to_json(), "device": device or None, **(more or {})})
        return
    if report.fit:
        note(report.fit)
    for iri, name in report.recognised.items():
        note(f"{iri} looks like {name}, and has that name now; `hereabouts retract` undoes it")
    summary = semantic_map.query("summary")
    print_table(summary.columns, summary.rows)
    note(
        f"{report.frames} frames in {report.seconds:.1f} s "
        f"({report.frames_per_second:.1f} frames/s"
        + (f", networks on {device})" if device else ")")
    )
    _note_labels(report)
    _note_detector(report, arguments)
    _note_sizes(semantic_map)
    if report.doubted:
        note(_doubted(report))
    note_unnamed(semantic_map)
    note("next: hereabouts ask MAP objects, hereabouts find MAP cup")


def _note_sizes(semantic_map: SemanticMap) -> None:
    """A line where things of most categories are larger or smaller than they usually are."""
    from kg.model.usual_sizes import unusual_scale

    label = semantic_map.catalogue.label
    factor = unusual_scale(
        (label(one.category), float(one.extent.max()))
        for one in semantic_map.objects(min_existence=0.5)
        if one.extent is not None
    )
    if factor is not None:
        note(
            f"things look {factor:.2g} times as large as they usually are: depth may have another "
            "unit; --depth-scale N gives its units a metre, and a new map is needed"
        )


def _doubted(report: MappingReport) -> str:
    """The line about things that were seen but are not believed."""
    from hereabouts.cli.candidates import listed_things

    count = f"{report.doubted} thing{'s' * (report.doubted > 1)}"
    found = listed_things(report.most_probable)
    return f"{count} seen but not believed: {found} (hereabouts why MAP --candidates)"


def _note_labels(report: MappingReport) -> None:
    made, unknown = report.provisional, report.unknown_labels
    if made:
        count = "1 label is a" if len(made) == 1 else f"{len(made)} labels are"
        ending = "y" if len(made) == 1 else "ies"
        note(f"{count} provisional categor{ending}: {_listed(made)} (--labels-map maps labels)")
    if unknown:
        count = f"{len(unknown)} label{'s' * (len(unknown) > 1)}"
        note(f"{count} without a category: {_listed(tuple(unknown))}")


def _note_detector(report: MappingReport, arguments: argparse.Namespace) -> None:
    """Tell, once on a machine, which detector names more things than the bundled ones."""
    from perception.inference.model_zoo import cache_folder, cached_path, find_model

    told = cache_folder() / "told-of-better-detector"
    if arguments.detector != "default" or not report.frames or told.exists():
        return
    fetch = f"`hereabouts models fetch {_BETTER}` downloads it and checks its SHA-256, then "
    if cached_path(find_model(_BETTER)).is_file():
        fetch = ""
    note(f"{_BETTER} {_BETTER_BY}: {fetch}--detector {_BETTER} uses it")
    with suppress(OSError):  # it is told again where nothing can be kept
        told.parent.mkdir(parents=True, exist_ok=True)
        told.touch()


def _listed(labels: tuple[str, ...]) -> str:
    more = f" and {len(labels) - _MAX_NAMED} more" if len(labels) > _MAX_NAMED else ""
    return ", ".join(labels[:_MAX_NAMED]) + more
