"""What the map knows comes first: exact positions, views that showed a thing, and finds."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Area
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, in_memory_map
from mapping.objects.extents.box_fit import NUMBERS
from mapping.objects.settings import ObjectSettings
from mapping.objects.track_store import RunState, TrackStore, seen_from
from mapping.objects.tracks import Track
from planner.freespace.floor_plan import free_space
from planner.search.goals.candidate_queries import existence_of
from planner.search.goals.targets import resolve
from planner.search.plans.answer_sentences import find_sentences
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import plan
from planner.search.viewpoints.candidate_views import candidate_views, sweep_chance
from planner.settings import BELIEF
from tests.planner.flat import fill, thing


@pytest.fixture
def flat() -> SemanticMap:
    return fill(in_memory_map(title="flat"))


@pytest.mark.parametrize("word", ["cup", "bed", "banana"])
def test_the_first_look_shows_a_known_thing(flat: SemanticMap, word: str) -> None:
    for start in ((6.0, 1.0), (11.0, 3.5), (1.0, 1.0)):
        state = build_search(flat, [word], start=start)
        assert state is not None
        assert state.space.nearest(start) in state.views.viewpoints
        first = plan(state, start, time_limit=math.inf).steps[0]
        assert first.why[0].candidate.kind == "known"
        assert first.probability > 0.5


def test_an_exact_position_is_found_at_once(flat: SemanticMap) -> None:
    exact = replace(thing(flat, "cup", 3.0, 1.0, 1), deviation=0.05)
    chances = []
    for cup in (flat.objects("cup")[0], exact):
        flat.apply(MapUpdate(objects=(replace(cup, iri=flat.objects("cup")[0].iri),)))
        state = build_search(flat, ["cup"])
        assert state is not None
        part = next(p for p in state.target_belief.parts if p.candidate.kind == "known")
        chances.append(part.weight.max())
    assert chances[1] > 2 * chances[0]


def test_a_find_is_known_as_found_until_it_is_missed() -> None:
    row = {"existence": 0.62, "foundBy": "search/1", "own": None}
    assert existence_of(row, BELIEF) == BELIEF.found
    assert existence_of({**row, "existence": 0.3}, BELIEF) == 0.3
    assert existence_of({**row, "foundBy": None}, BELIEF) == 0.62


def seen_by_a_camera(folder: Path, sequence: int, iri: str, p_map: np.ndarray) -> None:
    """Keep in a map's folder that a camera at (1.5, 1.0) m showed an object."""
    row = np.zeros(NUMBERS, np.float32)
    row[3], row[7] = 1.5, 1.0
    store = TrackStore(folder)
    store.load(sequence, ObjectSettings())
    track = Track(p_map, 0.1, ObjectSettings(), iri=iri, views={(0,): row})
    store.save([track], RunState(), sequence)
    store.close()


def test_a_camera_proves_what_a_wall_of_the_plan_hides(tmp_path: Path) -> None:
    seen_by_a_camera(tmp_path, 0, "cup", np.zeros(3))
    (pose,) = seen_from(tmp_path, ["cup", "bowl"])["cup"]
    space = free_space([Area(0, 3, 0, 3), Area(3, 6, 0, 3)], doors=())
    stand, hidden = space.nearest(pose[:2, 3]), space.nearest((4.0, 1.0))
    viewpoints = np.array([stand], np.intp)
    for pairs, chance in ((None, 0.0), (np.array([[stand, hidden]]), 0.7)):
        views = candidate_views(space, viewpoints=viewpoints, proven=pairs)
        at = int(np.searchsorted(views.cells, hidden))
        assert sweep_chance(views, stand, 0.0, 1.0)[at] == pytest.approx(chance)
        assert sweep_chance(views, stand, math.pi, 1.0)[at] == 0.0
        assert views.chance.greatest()[at] == pytest.approx(chance)


def test_a_seat_is_named_before_what_one_can_sit_on_too(flat: SemanticMap) -> None:
    flat.apply(MapUpdate(objects=(replace(thing(flat, "chair", 5, 1, 2), existence=0.6),)))
    (target,) = resolve(flat, ["something to sit on"])
    first, second = find_sentences(flat, target, 0.0)
    assert "chair" in first and "bed" in second


def test_a_memory_that_is_too_old_to_count_shows_no_cell(tmp_path: Path) -> None:
    folder = tmp_path / "flat.map"
    with fill(create_map(folder, title="flat")) as flat:
        (cup,) = flat.objects("cup")
        seen_by_a_camera(folder, flat.sequence, cup.iri, cup.p_map)
        fresh, old = (build_search(flat, ["cup"], at=cup.last_seen + later) for later in (1, 1e12))
    assert fresh is not None and len(fresh.views.proven) > 0
    assert old is not None and len(old.views.proven) == 0
