"""Key views beside a map: bounded, in step with its transactions, moved with corrected poses."""

from dataclasses import replace

import numpy as np
import pytest

from kg.serving.opening import create_map, open_map
from mapping.key_views import view_store
from mapping.key_views.view_store import FILE, ViewKeeper, ViewStore, stored_views
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.frames import Detections, Frame
from perception.odometry.spread_poses import is_new

NOBODY = np.zeros((0, 4), np.float32)
OPTIONS = MappingOptions(occupancy=False, check_poses=False, surface=None, pictures=False)


@pytest.fixture
def textured(make_frame):
    """Callable: number -> a frame of a textured wall, 0.3 m beside the one before."""

    def make(number: int) -> Frame:
        frame = make_frame(2.0, id=f"frame-{number}", stamp=1e9 + number)
        T = frame.T_map_cam.copy()
        T[1, 3] = 0.3 * number
        rgb = np.random.default_rng(number).integers(0, 255, (240, 320, 3)).astype(np.uint8)
        K = np.array([[250.0, 0, 160], [0, 250, 120], [0, 0, 1]])
        return replace(frame, rgb=rgb, depth=np.full((240, 320), 2, np.float32), K=K, T_map_cam=T)

    return make


@pytest.fixture
def nothing() -> Detections:
    return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())


def frames_in(path, sequence=1 << 40) -> list[str]:
    return [stored.frame for stored in stored_views(path, sequence)]


def test_mapping_keeps_views_of_new_poses_only(tmp_path, textured, nothing):
    with create_map(tmp_path / "a.map") as semantic_map:
        with Mapper(semantic_map, OPTIONS) as mapper:
            for number in (0, 0, 1, 1, 2, 0):
                mapper.add(textured(number), nothing)
        views = stored_views(semantic_map.store.path, semantic_map.sequence)
    assert [stored.frame for stored in views] == ["frame-0", "frame-1", "frame-2"]
    np.testing.assert_allclose(views[1].view.pose, textured(1).T_map_cam)
    with open_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        mapper.add(textured(1), nothing)  # a later run knows the views of the earlier one
        mapper.add(textured(3), nothing)
    assert frames_in(tmp_path / "a.map")[2:] == ["frame-2", "frame-3"]


def test_a_view_without_its_transaction_is_dropped(tmp_path, textured):
    with create_map(tmp_path / "a.map") as semantic_map:
        keeper = ViewKeeper(semantic_map, "room")
        keeper.add(textured(0), NOBODY)
        keeper.save(semantic_map.sequence + 1)  # and the run is killed here
        path, sequence = semantic_map.store.path, semantic_map.sequence
        assert frames_in(path, sequence) == []
        assert frames_in(path) == ["frame-0"]
        ViewKeeper(semantic_map, "room")
        assert frames_in(path) == []


def test_the_number_of_views_is_bounded(tmp_path, textured, nothing, monkeypatch):
    monkeypatch.setattr(view_store, "MAX_VIEWS", 3)
    with create_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        for number in (0, 1, 5, 9):
            mapper.add(textured(number), nothing)
        assert frames_in(semantic_map.store.path) == ["frame-1", "frame-5", "frame-9"]


def test_views_move_with_the_poses_of_their_frames(tmp_path, textured, nothing):
    with create_map(tmp_path / "a.map") as semantic_map:
        for name in ("one", "other"):
            number = 4 * (name == "other")
            with Mapper(semantic_map, OPTIONS, recording=name) as mapper:
                mapper.add(textured(number), nothing)
        path = semantic_map.store.path
        shift = np.eye(4)
        shift[0, 3] = 1.5
        ViewStore(path, semantic_map.sequence).move("one", {"frame-0": shift, "frame-4": shift})
    one, other = stored_views(path, 1 << 40)
    np.testing.assert_allclose(one.view.pose, shift @ textured(0).T_map_cam)
    np.testing.assert_allclose(other.view.pose, textured(4).T_map_cam)


@pytest.mark.parametrize("damage", [b"", b"no database" * 100])
def test_a_damaged_file_is_begun_anew(tmp_path, textured, nothing, damage):
    with create_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        mapper.add(textured(0), nothing)
    for suffix in ("-wal", "-shm"):
        (tmp_path / "a.map" / f"{FILE}{suffix}").unlink(missing_ok=True)
    (tmp_path / "a.map" / FILE).write_bytes(damage)
    assert frames_in(tmp_path / "a.map") == []
    with open_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        mapper.add(textured(1), nothing)
    assert frames_in(tmp_path / "a.map") == ["frame-1"]


def test_a_view_that_lies_is_refused(tmp_path, textured, nothing):
    with create_map(tmp_path / "a.map") as semantic_map, Mapper(semantic_map, OPTIONS) as mapper:
        mapper.add(textured(0), nothing)
        store = ViewStore(semantic_map.store.path, semantic_map.sequence)
        store.move("live", {"frame-0": np.full((4, 4), np.nan)})
        assert frames_in(semantic_map.store.path) == []


def test_poses_apart_by_distance_or_turn_are_new(make_frame):
    T = make_frame().T_map_cam
    near, far, turned = T.copy(), T.copy(), T.copy()
    near[0, 3] += 0.1
    far[0, 3] += 0.25
    turned[:3, :3] = turned[:3, :3] @ [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    assert is_new(T, [])
    assert not is_new(near, [T])
    assert is_new(far, [T])
    assert is_new(turned, [T])
    assert view_store.MAX_VIEWS * 20_000 < view_store.MAX_BYTES
