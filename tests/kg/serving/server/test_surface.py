"""`/surface`: the voxels of a served map, over HTTP and in Python."""

import numpy as np
import pytest

from kg.maps.surface.voxels import MEDIA_TYPE, FrameVoxels, Surface, decoded, encoded, keys_of
from kg.serving.opening import open_map


def shown(store, frames: int = 3) -> None:
    """A wall of 40 x 40 voxels, in red."""
    store.begin(0.025)
    x, z = (axis.ravel() for axis in np.mgrid[0:40, 0:40])
    seen = np.sort(keys_of(np.stack([x, np.full_like(x, -70), z])))
    colour = np.full((len(seen), 3), (200, 30, 30), np.uint8)
    for number in range(frames):
        frame = FrameVoxels(seen, colour, np.empty(0, np.int64), 1000.0 + number)
        store.write(frame, "flat", 1)
        store.accept(frame, "flat", 1)


@pytest.fixture
def walled(served):
    shown(served.map.surface_store)
    return served


def test_a_served_map_gives_its_surface(walled, monkeypatch):
    here = walled.map.surface()
    answer = walled.get("surface")
    assert answer.status_code == 200 and answer.headers["Content-Type"] == MEDIA_TYPE
    assert answer.headers["Content-Encoding"] == "gzip"
    with open_map(walled.url) as semantic_map:
        for there in (decoded(answer.content), semantic_map.surface()):
            assert there.size == here.size == 0.025 and len(there) == 1600
            np.testing.assert_allclose(there.points, here.points, atol=1e-5)
            for name in ("colours", "count", "last_seen"):
                np.testing.assert_array_equal(getattr(there, name), getattr(here, name))
        with semantic_map.at(semantic_map.sequence) as past:
            assert len(past.surface()) == 1600
    assert len(decoded(walled.get("surface?count=4").content)) == 0
    again = {"If-None-Match": answer.headers["ETag"]}
    assert walled.get("surface", headers=again).status_code == 304
    shown(walled.map.surface_store, 1)
    changed = walled.get("surface", headers=again)
    assert changed.status_code == 200 and (decoded(changed.content).count == 4).all()
    plain = walled.get("surface", headers={"Accept-Encoding": "identity"})
    assert "Content-Encoding" not in plain.headers and len(decoded(plain.content)) == 1600


def test_states_and_comparisons_tell_of_the_surface(walled):
    walled.put(3, "bowl", 2.0, 2.0)
    assert walled.get("state").json()["surface"] == 3
    shown(walled.map.surface_store, 1)
    assert walled.get("state").json()["surface"] == 4
    answer = walled.get("diff?from=0&to=2", headers={"Accept": "application/json"}).json()
    assert answer["surface"] == [0.0, 1.0]  # 1600 voxels of 2.5 cm
    text = walled.get("diff?from=1&to=2", headers={"Accept": "text/plain"}).text
    assert text.splitlines()[-1].endswith("1.0 m² of surface seen")
    assert walled.map.history.compare("#0", "#2").surface == (0.0, 1.0)


@pytest.mark.parametrize(("asked", "status"), [("count=x", 400), ("at=x", 400), ("at=999", 404)])
def test_what_is_no_moment_or_number_is_refused(walled, asked, status):
    assert walled.get(f"surface?{asked}").status_code == status


def test_a_map_without_a_surface_gives_an_empty_one(served):
    assert len(decoded(served.get("surface").content)) == 0


def test_a_large_surface_comes_in_larger_voxels():
    points = np.random.default_rng(1).uniform(-3, 3, (5000, 3)).astype(np.float32)
    points = (np.floor(points / 0.05) + np.float32(0.5)) * np.float32(0.05)
    n = len(points)
    surface = Surface(
        0.05, points, np.full((n, 3), 7, np.uint8), np.full(n, 9, np.uint16), np.full(n, 5.0)
    )
    small = decoded(encoded(surface, 400))
    assert 0 < len(small) <= 400 and small.size > 0.05
    assert (small.colours == 7).all() and np.abs(small.points).max() <= 3.4
