"""The room's images in a folder, named as a program names them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike

from perception.camera.poses import quaternion_from_pose
from tests.perception.conftest import SIZE, K, room_depth

CAMERA = {"fx": 130, "fy": 130, "cx": 79.5, "cy": 59.5}
STAMPS = [1_700_000_000.0 + i / 10 for i in range(6)]


def seven(T: np.ndarray) -> list[float]:
    return [*T[:3, 3], *quaternion_from_pose(T)]


def line(numbers: ArrayLike) -> str:
    return " ".join(f"{x:.9f}" for x in np.ravel(numbers)) + "\n"


def rows(T: np.ndarray) -> str:
    return "".join(map(line, T))


def named(pattern: str, i: int) -> str:
    """The name of image i: `n` is its number, `t`, `ns`, `ms` and `ros` are its stamp."""
    stamp, ns = STAMPS[i], round(STAMPS[i] * 10) * 10**8
    ros = f"{ns // 10**9}_{ns % 10**9}"
    return pattern.format(n=i, t=f"{stamp:.6f}", ns=ns, ms=round(stamp * 1e3), ros=ros)


class Room:
    """A folder of images of the room; `views` are its poses."""

    def __init__(self, folder: Path, views: list[np.ndarray]) -> None:
        self.folder, self.views = folder, views

    def path(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def write(self, name: str, text: str | bytes) -> Room:
        self.path(name).write_bytes(text.encode() if isinstance(text, str) else text)
        return self

    def images(self, colour: str, depth: str, scale: float = 1000) -> Room:
        """Depth is whole numbers of 1 / scale [m], or floats [m] where its name is no PNG."""
        for i, T in enumerate(self.views):
            cv2.imwrite(str(self.path(named(colour, i))), np.full((120, 160, 3), i, np.uint8))
            z, path = room_depth(T, K, SIZE), self.path(named(depth, i))
            if path.suffix == ".png":
                cv2.imwrite(str(path), np.rint(z * scale).astype(np.uint16))
                continue
            z[0, 0] = np.nan
            if path.suffix == ".npy":
                np.save(path, z.astype(np.float32))
            else:
                cv2.imwrite(str(path), z.astype(np.float32))
        return self

    def poses(self, pattern: str, lost: int | None = None, write=rows) -> Room:
        """A file of the pose of each image."""
        for i, T in enumerate(self.views):
            self.write(named(pattern, i), write(np.full((4, 4), -np.inf) if i == lost else T))
        return self

    def camera(self) -> Room:
        return self.write("intrinsics.json", json.dumps({**CAMERA, "depth_scale": 1000}))

    def tum(self, unit: float = 1.0, w_first: bool = False) -> list[str]:
        """Lines of stamps and poses."""
        lines = []
        for T, s in zip(self.views, STAMPS, strict=True):
            x, y, z, *q, w = seven(T)
            stamp = f"{s * unit:.0f} " if unit > 1 else f"{s:.6f} "
            lines.append(stamp + line((x, y, z, w, *q) if w_first else (x, y, z, *q, w)))
        return lines


@pytest.fixture
def room(tmp_path: Path, room_views: list[np.ndarray]) -> Room:
    return Room(tmp_path / "room", room_views)
