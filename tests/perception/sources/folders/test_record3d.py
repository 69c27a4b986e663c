"""Recordings of Record3D: .r3d files written with the library that reads them."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("lzfse")
import lzfse

from kg.model.errors import RecordingError
from perception.camera.poses import CONVENTIONS, quaternion_from_pose
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K, room_depth
from tests.perception.sources.folders.test_stray_scanner import (
    T_CAM_TURNED,
    T_WORLD_ROOM,
    upright_frames,
)

Phone = Callable[..., Path]
WIDTH, HEIGHT = SIZE


@pytest.fixture
def phone(tmp_path: Path, room_views: list[NDArray[np.float64]]) -> Phone:
    """Writes the room as a phone with LiDAR does: depth half as large as colour."""

    def write(turns: int = 0, changed: dict[str, Any] | None = None) -> Path:
        path = tmp_path / "room.r3d"
        aside = np.linalg.matrix_power(np.linalg.inv(T_CAM_TURNED), turns)
        poses = []
        with zipfile.ZipFile(path, "w") as archive:
            for i, T_room_upright in enumerate(room_views):
                T_room_phone = T_room_upright @ aside
                depth = room_depth(T_room_phone, K, SIZE).astype("<f4")[::2, ::2]
                sure = np.full(depth.shape, 2, np.uint8)
                sure[:, 0] = 0
                colour = np.full((HEIGHT, WIDTH, 3), 20 * i, np.uint8)
                archive.writestr(f"rgbd/{i}.jpg", cv2.imencode(".jpg", colour)[1].tobytes())
                archive.writestr(f"rgbd/{i}.depth", lzfse.compress(depth.tobytes()))
                archive.writestr(f"rgbd/{i}.conf", lzfse.compress(sure.tobytes()))
                T = CONVENTIONS["opengl"](T_WORLD_ROOM @ T_room_phone)
                poses.append([float(x) for x in (*quaternion_from_pose(T), *T[:3, 3])])
            card = {
                "w": WIDTH, "h": HEIGHT, "dw": WIDTH // 2, "dh": HEIGHT // 2, "fps": 30,
                "K": K.T.ravel().tolist(), "poses": poses,
                "frameTimestamps": [5 + i / 30 for i in range(len(poses))],
            } | (changed or {})  # fmt: skip
            card = {key: value for key, value in card.items() if value is not None}
            archive.writestr("metadata", json.dumps(card))
        return path

    return write


#: what else the app may write: cameras of single frames, or none of the sizes and stamps
OTHERS = (
    {"dw": None, "dh": None, "frameTimestamps": None},
    {"K": None, "perFrameIntrinsicCoeffs": [[K[0, 0], K[1, 1], K[0, 2], K[1, 2]]] * 6},
)


@pytest.mark.parametrize(("turns", "changed"), [*((n, {}) for n in range(4)),
                                                *((0, one) for one in OTHERS)])  # fmt: skip
def test_frames_have_their_depth_pose_and_stamp(phone: Phone, turns: int, changed: Any) -> None:
    upright_frames(phone(turns, changed), "record3d", turns)


def test_up_is_that_of_the_phone(phone: Phone) -> None:
    np.testing.assert_allclose(open_recording(phone(1)).T_map_world[2, :3], [0, 1, 0], atol=1e-9)


@pytest.mark.parametrize("poses", [None, [], [[0, 0, 0, 1, 0, 0, 0]] * 6])
def test_poses_that_are_missing_or_all_the_same_are_not_believed(phone, poses):
    path = phone(0, {"poses": poses})
    with pytest.raises(RecordingError, match=r"has no poses|one pose for all of its frames"):
        open_recording(path, RecordingOptions(estimate_poses=False))


def _replaced(path: Path, name: str, data: bytes) -> None:
    with zipfile.ZipFile(path) as archive:
        kept = {each: archive.read(each) for each in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for each, content in (kept | {name: data}).items():
            archive.writestr(each, content)


# [bytes] of zeros, as 64 blocks and the mark of the end
MANY = lzfse.compress(bytes(1 << 20)).removesuffix(b"bvx$") * 64 + b"bvx$"


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("metadata", b"[1]", "no JSON object"),
        ("metadata", b"{", "no JSON"),
        ("metadata", b'{"poses": [[0, 0]]}', "poses has 1 of 6 rows"),
        ("metadata", b'{"w": "x"}', "w is not 1 finite numbers"),
        ("rgbd/0.depth", b"", "ends too early"),
        ("rgbd/0.depth", b"nothing of the kind", "not compressed by LZFSE"),
        ("rgbd/0.depth", 100, "has 25 pixels"),
        ("rgbd/0.depth", MANY, "expands to more than"),
        ("rgbd/0.conf", 100, "confidence and its depth have other sizes"),
        ("rgbd/0.jpg", b"no image", "damaged image"),
    ],
)
def test_damage_is_told(phone: Phone, name: str, data: bytes | int, said: str) -> None:
    """A number stands for that many compressed zeros."""
    path = phone()
    _replaced(path, name, lzfse.compress(bytes(data)) if isinstance(data, int) else data)
    with pytest.raises(RecordingError, match=said):
        open_recording(path)


def test_what_is_no_zip_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.r3d").write_bytes(b"no zip")
    with pytest.raises(RecordingError, match=r"no zip, as \.r3d files are"):
        open_recording(tmp_path / "a.r3d")
