"""The mapper on a few real frames: recorded images, real networks, a map on disk."""

from collections.abc import Iterator

import pytest

from kg.serving.opening import create_map
from lab.maps.truth_matching import load_truth
from mapping.alignment.recording_fit import load_transform
from mapping.recording_mapper import map_recording
from mapping.reference.class_scores import score_map
from perception.frames import Frame
from perception.inference.detector import load_detector
from perception.inference.scene_classifier import load_scene_classifier
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions


class Every:
    """Every n-th frame of a recording."""

    def __init__(self, recording, n: int) -> None:
        self.recording, self.n = recording, n
        self.name, self.T_map_world = recording.name, recording.T_map_world

    def __len__(self) -> int:
        return len(range(0, len(self.recording), self.n))

    def frames(self, start: int = 0) -> Iterator[Frame]:
        for index in range(start * self.n, len(self.recording), self.n):
            yield next(iter(self.recording.frames(index)))


@pytest.fixture
def building(shared):
    """Callable: sequence -> every n-th frame, standing in the map of both rooms."""

    def open_room(sequence: str, n: int) -> Every:
        T = load_transform(shared("data/rgbd/composite_building.json"), sequence)
        options = RecordingOptions(T_map_world=T, check=False)
        return Every(open_recording(shared(f"data/rgbd/{sequence}"), options), n)

    return open_room


def test_kitchen_is_mapped_with_its_cups_and_chairs(tmp_path, shared, building):
    kitchen = building("redkitchen", 10)
    detector = load_detector(shared("models/deimv2_femto_416.onnx"), threshold=0.25)
    truth = load_truth(shared("data/rgbd/redkitchen/objects_gt.json"))
    with create_map(tmp_path / "kitchen.map") as semantic_map:
        map_recording(kitchen, semantic_map, detector, load_scene_classifier())
        (place,) = semantic_map.places()
        catalogue = semantic_map.catalogue
        found = [(catalogue.label(o.category), o.p_map) for o in semantic_map.objects()]
    score = score_map(found, truth, kitchen.T_map_world)
    assert score.recall >= 0.5
    assert score.position_error_median < 0.15
    assert score.per_class["cup"].matched == 2
    assert catalogue.label(max(place.beliefs, key=place.beliefs.__getitem__)) == "kitchen"
