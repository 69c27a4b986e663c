"""Maps to evaluate: given maps, or temporary maps of recordings by one or each mode."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import title_for
from hereabouts.cli.map_recording import map_frames
from hereabouts.cli.mapping_options import MODES, Networks, open_inputs
from hereabouts.cli.recording_options import recording_options
from kg.model.errors import LayoutError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kg.maps.semantic_map import SemanticMap
    from mapping.runs.progress_report import MappingReport


@dataclass(frozen=True, slots=True)
class Run:
    """The origin of a map: recording, mode and detector."""

    name: str  # of the recording or map
    mode: str = ""  # "" for a given map
    detector: str = ""
    report: MappingReport | None = None

    @property
    def title(self) -> str:
        """Name, mode and detector in one line."""
        return ", ".join(filter(None, (self.name, self.mode, self.detector)))

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        if self.report is None:
            return {"name": self.name}
        stages = {k: round(v, 2) for k, v in self.report.milliseconds.items()}
        return {
            "name": self.name,
            "mode": self.mode,
            "detector": self.detector,
            "frames": self.report.frames,
            "frames_per_second": round(self.report.frames_per_second, 2),
            "milliseconds_per_frame": stages,
        }


@dataclass(frozen=True, slots=True)
class EvaluatedMap:
    """An open map that is to be scored."""

    number: int  # index of its truth among the arguments
    run: Run
    semantic_map: SemanticMap
    T_map_world: NDArray[np.float64]  # (4, 4) from the truth's world to the map
    since: int = 0  # last transaction before the session of that truth


def check_usage(arguments: argparse.Namespace) -> None:
    """End the program, as wrong usage, for options that do not fit together."""
    maps, recordings, truths = arguments.maps, arguments.recording, arguments.truth
    if not maps and not recordings:
        arguments.usage_error("give a MAP or --recording DIR to score")
    if maps and arguments.compare:
        arguments.usage_error("--compare maps recordings: give --recording DIR and no MAP")
    if maps and recordings and len(recordings) != len(maps):
        arguments.usage_error("each MAP needs a --recording of its own, or none has one")
    if len(truths) != len(maps or recordings):
        arguments.usage_error("each MAP or --recording needs a --truth of its own, in their order")
    sessions = arguments.sessions
    if sessions < 1 or (sessions > 1 and (maps or len(recordings) % sessions)):
        arguments.usage_error(
            f"--sessions {sessions} needs a number N of 1 or more, and N recordings for each place"
        )


def evaluated_maps(arguments: argparse.Namespace) -> Iterator[EvaluatedMap]:
    """Each map in turn, open until the next one is asked for; recordings are mapped first."""
    recordings = arguments.recording or [None] * len(arguments.maps)
    if not arguments.maps:
        for number in range(0, len(recordings), arguments.sessions):
            yield from _mapped(arguments, number, recordings[number : number + arguments.sessions])
    for number, address in enumerate(arguments.maps):
        yield from _given(arguments, number, address, recordings[number])


def _given(
    arguments: argparse.Namespace, number: int, address: str, folder: str | None
) -> Iterator[EvaluatedMap]:
    from kg.serving.opening import open_map

    with open_map(address, read_only=True) as semantic_map:
        T_map_world = _transform(arguments, address, semantic_map, folder)
        yield EvaluatedMap(number, Run(title_for(address)), semantic_map, T_map_world)


def _transform(
    arguments: argparse.Namespace, address: str, semantic_map: SemanticMap, folder: str | None
) -> NDArray[np.float64]:
    """The transform from the world of a truth to the map: that of its recording."""
    import numpy as np

    from perception.sources.recording import open_recording

    known = {record.name: record.T_map_world for record in semantic_map.recordings()}
    name = arguments.name or (Path(folder).resolve().name if folder else None)
    worlds = list(known.values())
    if name is None and worlds and all(np.array_equal(T, worlds[0]) for T in worlds):
        return worlds[0]
    if name in known:
        return known[name]
    if folder is not None:
        return open_recording(folder, recording_options(arguments, folder)).T_map_world
    named = ", ".join(known) or "(none)"
    wanted = f", not {name!r}" if name else ""
    raise LayoutError(
        f"cannot tell the world frame of the truth: {address} has the recordings {named}{wanted}; "
        "give --name NAME of one of them, or --recording DIR"
    )


def _mapped(
    arguments: argparse.Namespace, first: int, folders: Sequence[str]
) -> Iterator[EvaluatedMap]:
    """Temporary maps, one for each mode, of the recordings `folders` one after another.

    `first` is the index of the first recording's truth. The networks run once on each frame.
    """
    from kg.serving.opening import create_map

    networks = dict[str, Networks]()
    for mode in MODES if arguments.compare else (arguments.mode,):
        with (
            TemporaryDirectory(prefix="hereabouts-evaluate-") as temporary,
            create_map(Path(temporary) / "evaluate.map", title="evaluate") as semantic_map,
        ):
            for number, folder in enumerate(folders, start=first):
                inputs = open_inputs(arguments, folder, mode)
                recording, opened = inputs.recording, inputs.networks
                if arguments.compare:
                    opened = networks.setdefault(folder, _remembering(opened))
                since = semantic_map.sequence
                report = map_frames(recording, semantic_map, opened, inputs.options)
                run = Run(recording.name, mode, opened.detector.name, report)
                yield EvaluatedMap(number, run, semantic_map, recording.T_map_world, since)


def _remembering(networks: Networks) -> Networks:
    from lab.networks.repeated_frames import RememberingSceneClassifier
    from perception.inference.detector_pair import RememberingDetector

    scene = None if networks.scene is None else RememberingSceneClassifier(networks.scene)
    return Networks(RememberingDetector(networks.detector), scene)
