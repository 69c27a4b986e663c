"""Corrected poses move what perception found; what persons stated of things outlasts them."""

import numpy as np
import pytest

from mapping.alignment.pose_correction import correct_poses
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from perception.sources.live.live_recording import KeptFrames

MIDDLE, SIDE = (30, 22, 34, 26), 52.0  # [px], and [px m] from the middle to a thing beside it
OPTIONS = MappingOptions(pictures=False, find_places=False)
#: of a thing that the corrected poses do not show any more
STATED = {
    "name": "my mug",
    "label": "the blue one",
    "category": "bowl",
    "position": "2 0.1 1",
    "extent": "0.1 0.1 0.1",
    "existence": "present",
    "on": "nothing",
}


@pytest.mark.parametrize("stated", [*STATED, None])
def test_a_thing_stays_by_what_a_person_stated(
    semantic_map, step_back, scripted_detector, make_detections, stated
):
    frames = [step_back(n) for n in range(6)]
    cup, vase = ("cup", 0.9, MIDDLE), dict[str, tuple[str, float, tuple[float, ...]]]()
    for frame in frames:
        left = 30 - SIDE / float(frame.depth[24, 32])
        vase[frame.id] = ("vase", 0.9, (left, 22, left + 4, 26))
    both = {frame: make_detections(cup, beside) for frame, beside in vase.items()}
    without = {frame: make_detections(beside) for frame, beside in vase.items()}
    with KeptFrames() as kept:
        for frame in frames:
            kept.add(frame)
        before = kept.recording("room", np.eye(4), estimated=False)
        map_recording(before, semantic_map, scripted_detector(both, None), options=OPTIONS)
        label = semantic_map.catalogue.label
        cup, other = sorted(semantic_map.objects(), key=lambda one: label(one.category))
        if stated is not None:
            semantic_map.assertions.add(cup.iri, stated, STATED[stated], by="ann")
        asserted = {one.property: one.value for one in semantic_map.assertions.all(cup.iri)}

        moved = {frame.id: frame.T_map_cam.copy() for frame in frames}
        for T in moved.values():
            T[1, 3] += 0.2
        correct_poses(
            kept.recording("room", np.eye(4), moved, estimated=False),
            before,
            semantic_map,
            lambda one, into: map_recording(
                one, into, scripted_detector(without, None), options=OPTIONS
            ),
            OPTIONS,
        )
    found = {one.iri: one.p_map for one in semantic_map.objects()}
    assert found.keys() == ({other.iri} if stated is None else {cup.iri, other.iri})
    assert found[other.iri] == pytest.approx(other.p_map + np.array([0, 0.2, 0]), abs=0.02)
    kept_facts = {one.property: one.value for one in semantic_map.assertions.all(cup.iri)}
    assert kept_facts == asserted
