"""A small map that has been written to for a while."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyoxigraph import CanonicalizationAlgorithm, Dataset, Quad, Store

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import (
    Evidence,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
)
from kg.serving.opening import create_map

BASE = "https://example.org/flat/"


def thing(semantic_map: SemanticMap, label: str = "cup", **fields: object) -> ObjectRecord:
    """A new object at (1, 2, 0.5) m, of existence 0.5, that was seen once; `fields` differ."""
    record = ObjectRecord(
        iri=str(fields.pop("iri", "")) or semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find(label, "object").iri,
        p_map=np.array([1.0, 2.0, 0.5]),
        confidence=1.0,
        existence=0.5,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
    )
    return replace(record, **fields)  # type: ignore[arg-type]


def canonical(quads: Iterable[Quad]) -> set[str]:
    """Values as a store keeps them (1.0e0 is 1), blank nodes named by what is said of them."""
    store = Store()
    store.extend(quads)
    dataset = Dataset(store)
    dataset.canonicalize(CanonicalizationAlgorithm.UNSTABLE)
    return {str(quad) for quad in dataset}


def frame_update(frame: int, *, removed: tuple[str, ...] = ()) -> MapUpdate:
    """Frame `frame` of a recording in which two chairs are seen better and better."""
    chairs = tuple(
        ObjectRecord(
            iri=f"{BASE}object/{number}",
            category=v.HERE + "Chair",
            p_map=np.array([number + 0.01 * frame, 1.0, 0.5]),
            confidence=min(3.0, 0.3 * (frame + 1)),
            existence=min(1.0, 0.1 * (frame + 1)),
            observations=frame + 1,
            first_seen=1e9,
            last_seen=1e9 + frame,
            place=f"{BASE}place/1",
            evidence=Evidence(
                f"frame-{frame:06d}",
                "flat",
                1e9 + frame,
                (1.0, 2.0, 3.0 + frame, 4.0),
                min(1.0, 0.5 + 0.01 * frame),
                "deimv2",
            ),
        )
        for number in (1, 2)
        if f"{BASE}object/{number}" not in removed
    )
    beliefs = {v.HERE + "Kitchen": 0.75, v.HERE + "Office": 0.25}
    place = PlaceRecord(f"{BASE}place/1", "place 1", 0.0, 4.0, 0.0, 3.0, 1 + frame // 5, beliefs)
    return MapUpdate(
        objects=chairs,
        removed=removed,
        places=(place,),
        robot=RobotRecord(np.array([0.1 * frame, 0.0, 1.2]), 0.5, 1e9 + frame),
        recording=RecordingRecord("flat", frame + 1, f"frame-{frame:06d}", np.eye(4), "rooms6"),
    )


@pytest.fixture
def written(tmp_path: Path) -> Callable[[int], SemanticMap]:
    """Callable: a map on disk after that many frames."""

    def write(frames: int) -> SemanticMap:
        semantic_map = create_map(tmp_path / "flat.map", base=BASE)
        for frame in range(frames):
            semantic_map.apply(frame_update(frame))
        return semantic_map

    return write


@pytest.fixture(scope="session")
def frame() -> Callable[..., MapUpdate]:
    """Callable: the update of one frame, perhaps with objects that leave the map."""
    return frame_update
