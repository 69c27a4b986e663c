"""`hereabouts map`: a recording becomes a map."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kg.errors import GraphError, LayoutError, MapNotFoundError, RecordingError
from planner.cli.arguments import MAP_HELP, add_json, add_keep, keep_seconds, title_for
from planner.cli.console import note, print_table, progress, write_json
from planner.cli.recording_arguments import Inputs, MappingInputs, open_given_recording, open_inputs
from planner.cli.recording_options import add_recording_options
from planner.cli.teach import with_taught_rooms
from planner.cli.viewers import add_viewers, open_viewers

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from mapping.label_table import LabelTable
    from mapping.progress_report import FrameReport, MappingReport
    from mapping.recording_mapper import OnDetections
    from perception.frames import Detections, Frame, Recording, SceneScores
    from planner.viewers.viewer import Viewer

_TOLD = 10  # labels named in one note


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "map",
        help="map a recording: RGB-D frames with poses in, objects and places out",
        description="Map a recording into a new map, or into an existing one. A run that was cut "
        "short goes on where it stopped.",
        epilog="example: hereabouts map recordings/kitchen --into kitchen.map",
    )
    parser.add_argument("recording", metavar="RECORDING", help="folder of the recording")
    parser.add_argument(
        "--again", action="store_true", help="map frames again that this map already holds"
    )
    add_map_options(parser)
    add_recording_options(parser)
    parser.set_defaults(run=run)


def add_map_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that `open_for_mapping` and `print_outcome` read."""
    parser.add_argument("--into", required=True, metavar="MAP", help=MAP_HELP)
    parser.add_argument("--pictures", metavar="DIR", help="save frames with boxes and scene scores")
    add_viewers(parser)
    parser.add_argument(
        "--base", metavar="IRI", help="base IRI of a new map (default: a unique one)"
    )
    parser.add_argument(
        "--power-safe",
        action="store_true",
        help="wait for the disk at each frame, so that a power cut loses nothing",
    )
    add_keep(parser, "default: all of the past; the rest is dropped while mapping")
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Map the recording, and say what was found."""
    inputs = open_inputs(arguments)
    with (
        open_viewers(arguments, title_for(arguments.into)) as viewer,
        open_for_mapping(arguments, inputs, viewer) as (semantic_map, on_detections),
    ):
        if inputs.corrected and _correct_poses(inputs, semantic_map, arguments):
            return 0
        inputs = replace(inputs, scene=with_taught_rooms(inputs.scene, arguments.into))
        if inputs.align:
            inputs = align_with_map(inputs, semantic_map)
        report = map_with_progress(
            inputs, semantic_map, on_detections=on_detections, again=arguments.again
        )
        if report.frames == 0:
            note(
                f"all {report.skipped} frames are already in this map; --again maps them once more"
            )
        print_outcome(semantic_map, report, arguments, inputs.device)
    return 0


@contextmanager
def open_for_mapping(
    arguments: argparse.Namespace, inputs: MappingInputs, viewer: Viewer | None
) -> Iterator[tuple[SemanticMap, OnDetections | None]]:
    """The map to write into, and what is called with each mapped frame, which `viewer` gets."""
    from kg.opening import open_or_create_map
    from kg.store.gc_freezing import gc_frozen

    keep = keep_seconds(arguments)
    if inputs.labels is not None:
        _refuse_unknown_categories(inputs.labels, arguments.into)
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
        _refuse_other_base(semantic_map, arguments)
        if keep is not None:
            semantic_map.retain(keep)
        with gc_frozen():
            yield semantic_map, on_detections


def _refuse_other_base(semantic_map: SemanticMap, arguments: argparse.Namespace) -> None:
    """Refuse a `--base` that is not the one of the map that exists already."""
    given = arguments.base
    if given is not None and semantic_map.base not in (given, f"{given}/"):
        raise GraphError(
            f"{arguments.into} has the base {semantic_map.base}; another one needs another map"
        )


def _correct_poses(
    inputs: Inputs, semantic_map: SemanticMap, arguments: argparse.Namespace
) -> bool:
    """Move what the map has of the recording to its corrected poses; whether it has anything."""
    from mapping.alignment.pose_correction import correct_poses, is_mapped

    if not is_mapped(inputs.recording, semantic_map):
        return False
    as_mapped = argparse.Namespace(**vars(arguments) | {"poses": None, "no_check": True})
    report = correct_poses(
        inputs.recording,
        open_given_recording(as_mapped),
        semantic_map,
        lambda recording, apart: map_with_progress(
            replace(inputs, recording=recording, find_places=False), apart
        ),
        layout=inputs.layout,
        find_places=inputs.find_places and inputs.floor,
    )
    if arguments.json:
        write_json(report.to_json())
        return True
    summary = semantic_map.query("summary")
    print_table(summary.columns, summary.rows)
    note(
        f"{report.recording} by its corrected poses: {report.kept} objects moved by "
        f"{report.distance:.2f} m (median), {report.new} new, {report.removed} gone, "
        f"{report.tiles} floor tiles changed"
    )
    return True


def refuse_mapped(inputs: Inputs, semantic_map: SemanticMap) -> None:
    """Refuse corrected poses of a recording that the map holds, where they would move nothing."""
    from mapping.alignment.pose_correction import is_mapped

    if is_mapped(inputs.recording, semantic_map):
        raise LayoutError(
            f"{inputs.recording.name!r} is in this map already; "
            "`hereabouts map ... --into MAP --poses FILE` moves it to its corrected poses"
        )


def align_with_map(inputs: Inputs, semantic_map: SemanticMap) -> Inputs:
    """Align a recording that is new to the map with it, and say how."""
    from mapping.alignment.recording_fit import aligned

    recording, told = aligned(inputs.recording, semantic_map, inputs.detector, labels=inputs.labels)
    if told:
        note(told)
        rows = " ".join(f"{x:.6g}" for x in recording.T_map_world.ravel())
        note(f"T_map_world, row by row: {rows}")
    return replace(inputs, recording=recording)


def map_with_progress(
    inputs: Inputs,
    semantic_map: SemanticMap,
    *,
    on_detections: OnDetections | None = None,
    again: bool = False,
) -> MappingReport:
    """Run the mapping pipeline under a progress bar."""
    return map_frames(
        inputs.recording, inputs, semantic_map, on_detections=on_detections, again=again
    )


def map_frames(
    recording: Recording,
    inputs: MappingInputs,
    semantic_map: SemanticMap,
    *,
    on_detections: OnDetections | None = None,
    again: bool = False,
    lost: Callable[[], str] | None = None,
) -> MappingReport:
    """Run the mapping pipeline on frames; `lost` says of live ones how many were left out."""
    from mapping.read_ahead import AHEAD
    from mapping.recording_mapper import map_recording

    with progress() as bar:
        total = len(recording) if lost is None else None
        task = bar.add_task(recording.name, total=total, status="")

        def on_frame(report: FrameReport) -> None:
            rate = report.frames_per_second
            bar.update(
                task,
                completed=report.index + 1,
                status=f"{rate:4.1f} frames/s  {report.objects} objects"
                + ("" if lost is None else f"  {lost()}"),
            )

        return map_recording(
            recording,
            semantic_map,
            inputs.detector,
            inputs.scene,
            mode=inputs.mode,
            layout=inputs.layout,
            find_places=inputs.find_places,
            settings=inputs.settings,
            on_frame=on_frame,
            on_detections=on_detections,
            again=again,
            labels=inputs.labels,
            occupancy=inputs.floor,
            same_frame=inputs.same_frame,
            check_poses=inputs.check,
            pictures=inputs.pictures,
            objects=inputs.objects,
            ahead=AHEAD if lost is None else 1,
        )


def _refuse_unknown_categories(labels: LabelTable, address: str) -> None:
    """Refuse a labels map before the map it does not fit is made or opened for writing."""
    from kg.ontology.catalogue import Catalogue
    from kg.ontology.loading import load_ontologies
    from kg.opening import open_map

    try:
        with open_map(address, read_only=True) as semantic_map:
            catalogue = semantic_map.catalogue
    except MapNotFoundError:
        catalogue = Catalogue.from_quads(load_ontologies().quads)
    labels.refuse_unknown(catalogue)


@contextmanager
def _watched(
    semantic_map: SemanticMap, viewer: Viewer | None, save: OnDetections | None
) -> Iterator[OnDetections | None]:
    """What is called with each mapped frame: pictures are saved, a viewer is fed."""
    if viewer is None:
        yield save
        return
    from planner.viewers.feed import MappingFeed

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
    """Say what was found; `more` is for `--json`."""
    if arguments.json:
        write_json({**report.to_json(), "device": device or None, **(more or {})})
        return
    if report.fit:
        note(report.fit)
    summary = semantic_map.query("summary")
    print_table(summary.columns, summary.rows)
    stages = "  ".join(f"{stage} {ms:.1f}" for stage, ms in report.milliseconds.items())
    note(
        f"{report.frames} frames in {report.seconds:.1f} s "
        f"({report.frames_per_second:.1f} frames/s); ms a frame, side by side: {stages}"
        + (f"; networks on {device}" if device else "")
    )
    _note_labels(report)
    _note_detector(report, arguments)
    if report.doubted:
        note(_doubted(report, arguments.into))
    note(f"next: hereabouts ask {arguments.into} objects, hereabouts find {arguments.into} cup")


def _doubted(report: MappingReport, address: str) -> str:
    """The line about things that were seen but are not believed."""
    from planner.cli.doubted_things import listed_things

    count = f"{report.doubted} thing{'s' * (report.doubted > 1)}"
    found = listed_things(report.most_probable)
    return f"{count} seen but not believed: {found} (hereabouts why {address} --candidates)"


def _note_labels(report: MappingReport) -> None:
    made, unknown = report.provisional, report.unknown_labels
    if made:
        what = "1 label is a" if len(made) == 1 else f"{len(made)} labels are"
        ending = "y" if len(made) == 1 else "ies"
        note(f"{what} provisional categor{ending}: {_listed(made)} (--labels-map maps labels)")
    if unknown:
        count = len(unknown)
        note(f"{count} label{'s' * (count > 1)} without a category: {_listed(tuple(unknown))}")


def _note_detector(report: MappingReport, arguments: argparse.Namespace) -> None:
    """After the bundled detectors: which one sees more."""
    from perception.inference.model_zoo import best_detector, bundled_pair, find_model

    if arguments.detector == "default" and report.frames:
        best, bundled = best_detector(), max(find_model(n).ap or 0.0 for n in bundled_pair())
        fetches = "takes" if best.where == "fetched" else "fetches"
        note(
            f"{best.name} sees more ({best.ap} AP on COCO, the bundled ones {bundled}): "
            f"--detector best {fetches} it"
        )


def _listed(labels: tuple[str, ...]) -> str:
    more = f" and {len(labels) - _TOLD} more" if len(labels) > _TOLD else ""
    return ", ".join(labels[:_TOLD]) + more
