"""Sightings and tracks of things with given boxes, for the Bayes mapper's parts."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.usual_sizes import SizeOf, UsualSize
from mapping.frames.sighting import ThingSighting
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track
from perception.frames import Frame
from tests.mapping.objects.room import Room

SETTINGS = ObjectSettings()
USUAL = {
    "cup": UsualSize(0.1, 0.08),
    "bottle": UsualSize(0.25, 0.08),
    "dining table": UsualSize(1.6, 0.8),
    "tv": UsualSize(0.8, 0.1),
    "laptop": UsualSize(0.35, 0.25),
}


@pytest.fixture
def usual_size() -> SizeOf:
    """Callable: category -> its usual size, None where it has none."""
    return USUAL.get


@pytest.fixture
def make_sighting() -> Callable[..., ThingSighting]:
    """Callable: scores by category, position [m] -> sighting of a cube at it, 2 m away."""

    def make(scores, p_map, *, size=0.1, sides=None, cut=False, detector=""):
        at = np.array(p_map, dtype=np.float64)
        half = np.full(3, size / 2) if sides is None else np.array(sides) / 2
        return ThingSighting(
            scores={(detector, category): score for category, score in scores.items()},
            p_map=at,
            low=at - half,
            high=at + half,
            size=size,
            depth=2.0,
            box=(10.0, 10.0, 20.0, 20.0),
            cut=cut,
            categories=frozenset(scores),
        )

    return make


@pytest.fixture
def make_track(make_sighting: Callable[..., ThingSighting]) -> Callable[..., Track]:
    """Callable: category, position [m] -> track of `views` sure sightings of such a cube."""

    def make(category: str, p_map: Sequence[float], *, views: int = 3, **of: object) -> Track:
        sighting = make_sighting({category: 0.8}, p_map, **of)
        track = Track(p_map=sighting.p_map, size=sighting.size, settings=SETTINGS)
        for view in range(views):
            track.locate(sighting, track.look((view,)))
            track.hit({category: 0.9}, 4.0, 1.0)
        track.assess({}.get)
        return track

    return make


@pytest.fixture
def room(semantic_map: SemanticMap, step_back: Callable[..., Frame]) -> Iterator[Room]:
    made = Room(semantic_map, step_back)
    yield made
    assert check_map(semantic_map.engine) == []
