"""Small worlds in which every rule of the mapper can be worked out by hand."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from kg.model.errors import RecordingError
from kg.model.records import ObjectRecord
from perception.frames import Detections, Frame, SceneScores

#: camera -> map: looks along map x, image right is map -y, image down is map -z; 1 m above floor
LOOK_ALONG_X = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]
)


@pytest.fixture
def make_frame() -> Callable[..., Frame]:
    """Callable: depth image or constant depth [m] -> 65 x 49 frame, f = 50, looking along x."""

    def make(depth=2.0, *, T=LOOK_ALONG_X, id="frame-000000", stamp=1_000_000.0):
        image = np.broadcast_to(np.asarray(depth, dtype=np.float32), (49, 65)).copy()
        K = np.array([[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]])
        rgb = np.full((49, 65, 3), 1, dtype=np.uint8)
        return Frame(id, rgb, image, K, np.asarray(T, dtype=np.float64), stamp)

    return make


@pytest.fixture
def step_back(make_frame: Callable[..., Frame]) -> Callable[..., Frame]:
    """Callable: number n, depth [m] of the wall seen by view 0 -> view n, 0.3 n m farther back.

    Each is a distinct view of what stands before the wall on the optical axis.
    """

    def view(n: int, depth: float = 2.0, **fields: object) -> Frame:
        T = make_frame().T_map_cam.copy()
        T[0, 3] = -0.3 * n
        given = {"id": f"frame-{n:06d}", "stamp": 1e9 + n, **fields}
        return make_frame(depth + 0.3 * n, T=T, **given)

    return view


@pytest.fixture
def make_detections() -> Callable[..., Detections]:
    """Callable: (label, score, box) ... -> Detections."""

    def make(*found: tuple[str, float, Sequence[float]]) -> Detections:
        return Detections(
            np.array([box for _, _, box in found], dtype=np.float32).reshape(-1, 4),
            np.array([score for _, score, _ in found], dtype=np.float32),
            tuple(label for label, _, _ in found),
        )

    return make


@pytest.fixture
def make_object() -> Callable[..., ObjectRecord]:
    """Callable: number, category, position [m] -> ObjectRecord."""

    def make(number, category, p_map, *, confidence=1.0, observations=1):
        return ObjectRecord(
            iri=f"https://example.org/object/{number}",
            category=category,
            p_map=np.array(p_map, dtype=np.float64),
            confidence=confidence,
            existence=confidence / 3,
            observations=observations,
            first_seen=0.0,
            last_seen=0.0,
        )

    return make


class ListRecording:
    """A recording made of given frames; the ones in `broken` cannot be read."""

    def __init__(self, frames, *, name="room", broken=frozenset()):
        self.name = name
        self.T_map_world = np.eye(4)
        self.all = tuple(frames)
        self.broken = broken

    def __len__(self) -> int:
        return len(self.all)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        for index in range(start, len(self.all)):
            if index in self.broken:
                raise RecordingError(f"frame {index} is truncated")
            yield self.all[index]


class ScriptedDetector:
    """Finds in each frame what the script says, by frame id."""

    name = "scripted"

    def __init__(self, script: dict[str, Detections], otherwise: Detections) -> None:
        self.script, self.otherwise = script, otherwise
        self.asked: list[str] = []

    def detect(self, frame: Frame) -> Detections:
        self.asked.append(frame.id)
        return self.script.get(frame.id, self.otherwise)


class ScriptedScene:
    """Sees the same kind of place in every frame."""

    name = "scripted"

    def __init__(self, probability: dict[str, float]) -> None:
        self.scores = SceneScores(probability)
        self.asked: list[str] = []

    def classify(self, frame: Frame) -> SceneScores:
        self.asked.append(frame.id)
        return self.scores


@pytest.fixture
def list_recording() -> type[ListRecording]:
    return ListRecording


@pytest.fixture
def scripted_detector() -> type[ScriptedDetector]:
    return ScriptedDetector


@pytest.fixture
def scripted_scene() -> type[ScriptedScene]:
    return ScriptedScene
