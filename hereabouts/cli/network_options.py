"""Options of networks on the command line: their arguments, and opened networks."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import declare, options_of, share
from hereabouts.cli.models import named_detector
from kg.model.errors import RecordingError
from mapping.objects.settings import ObjectSettings

if TYPE_CHECKING:
    from perception.frames import Detector, SceneClassifier

#: minimum score of reported detections, as a share of the minimum score of mapped ones: the mapper
#: counts the weaker ones for `hereabouts why --candidates`
_REPORTED: Final = 0.5
_MAPPED: Final = ObjectSettings().min_score  # minimum score of mapped detections in bayes mode

#: before the name of a topic of detections, in place of a detector's name
TOPIC: Final = "topic:"


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkOptions:
    """The networks to run, by name or file, and how."""

    detector: str = "default"
    second_detector: str | None = None  # runs on new points of view; None: no second one
    scene: str = "none"  # scene classifier
    device: str = "auto"
    head: str | None = None  # meaning of the detector's outputs; None: as its answers tell
    threshold: float = _REPORTED * _MAPPED  # score below which detectors drop detections


@dataclass(frozen=True, slots=True)
class Networks:
    """Opened networks."""

    detector: Detector
    scene: SceneClassifier | None = None

    @property
    def device(self) -> str:
        """Device on which the networks run; "" without networks."""
        return str(getattr(self.detector, "device", None) or getattr(self.scene, "device", ""))


_NETWORK_ARGUMENTS = """
--detector NAME|FILE    object detector, or a JSON file of recorded detections, here or in the
                        recording's folder; best: the best detector, downloaded if needed; live:
                        topic:NAME, detections of another program (default: the bundled ones; see
                        `hereabouts models list`)
--second-detector NAME|FILE  another detector, which runs on frames from new points of view
--head NAME             meaning of the detector's outputs, where an error names two
--threshold THRESHOLD   minimum score of a detection (default: 0.2; in reference mode: 0.4)
--device
--scene NAME|FILE|none  scene classifier (default: the bundled one)
"""


def add_network_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `network_options` reads."""
    group = parser.add_argument_group("networks")
    declare(
        group,
        _NETWORK_ARGUMENTS,
        detector={"default": "default"},
        threshold=share,
        scene={"default": "default"},
    )


def network_options(arguments: argparse.Namespace) -> NetworkOptions:
    """The networks that the arguments name."""
    threshold = _REPORTED * (arguments.threshold or _MAPPED)
    return options_of(NetworkOptions, arguments, threshold=threshold)


def open_networks(
    options: NetworkOptions, folder: str | None = None, *, live: bool = False
) -> Networks:
    """Open the networks; a file of recorded detections may be in the recording's `folder`.

    Where frames come `live` from topics, detections may, too. Raises ModelError or RecordingError.
    """
    from perception.inference.detector_pair import DetectorPair
    from perception.inference.recorded_detections import open_detector
    from perception.inference.scene_classifier import load_scene_classifier

    o, name = options, named_detector(options.detector)
    if folder is not None and name.endswith(".json") and not Path(name).exists():
        inside = Path(folder) / name
        name = str(inside) if inside.exists() else name
    detector: Detector
    if name.startswith(TOPIC) and not live:
        raise RecordingError(
            f"{name}: detections come by a topic where frames do: `live`, `search`"
        )
    if name.startswith(TOPIC):
        from perception.sources.live.topic_detector import TopicDetector

        detector = TopicDetector(name.removeprefix(TOPIC), o.threshold)
    else:
        detector = open_detector(name, threshold=o.threshold, device=o.device, head=o.head)
    if o.second_detector is not None:
        second = open_detector(o.second_detector, threshold=o.threshold, device=o.device)
        detector = DetectorPair(detector, second)
    scene = None if o.scene == "none" else load_scene_classifier(o.scene, device=o.device)
    return Networks(detector, scene)
