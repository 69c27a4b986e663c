"""Recordings and networks that tests write to disk."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

ROOM = np.array([[-2.0, 2.0], [-1.5, 2.5], [0.0, 2.4]])  # [m] x, y, z of a room, z up
SIZE = (160, 120)
K = np.array([[130.0, 0, 79.5], [0, 130.0, 59.5], [0, 0, 1]])


def look_at(eye: Sequence[float], target: Sequence[float]) -> NDArray[np.float64]:
    """T_map_cam (4, 4) of a camera at `eye` that looks at `target`, held level."""
    z = np.array(target, np.float64) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    T[:3, 3] = eye
    return T


def room_depth(T: NDArray[np.float64], K: NDArray[np.float64], size: tuple[int, int]) -> NDArray:
    """(H, W) [m] depth of the empty room seen from T (4, 4)."""
    v, u = np.mgrid[0 : size[1], 0 : size[0]]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
    world = rays @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        reach = (np.where(world > 0, ROOM[:, 1], ROOM[:, 0]) - T[:3, 3]) / world
    return reach.min(-1)


@pytest.fixture(scope="session")
def room_views() -> list[NDArray[np.float64]]:
    """Six camera poses (4, 4) in the room, looking down a little, turning about."""
    angles = np.linspace(0, 2, 6)
    return [
        look_at((0.2 * i - 0.5, 0, 1.4), (2 * np.cos(a), 2 * np.sin(a), 0.7))
        for i, a in enumerate(angles)
    ]


@pytest.fixture
def hololens(tmp_path: Path, room_views: list[NDArray[np.float64]]) -> Callable[..., Path]:
    """Writes the room as a HoloLens recording; T_world_room (4, 4) sets its world askew."""

    def write(T_world_room: NDArray[np.float64] | None = None, *, depth_step: int = 1) -> Path:
        folder = tmp_path / "room"
        (folder / "images").mkdir(parents=True)
        (folder / "depth").mkdir()
        rows = []
        for i, T in enumerate(room_views):
            depth = room_depth(T, K, SIZE)[::depth_step, ::depth_step]
            # unpadded numbers: 10 comes after 9, not after 1
            number = 8 + i
            rgb = np.full((SIZE[1], SIZE[0], 3), (10 + i, 100, 200), np.uint8)
            cv2.imwrite(str(folder / "images" / f"{number}.png"), rgb[:, :, ::-1])
            cv2.imwrite(
                str(folder / "depth" / f"{number}.png"), np.rint(depth * 1000).astype(np.uint16)
            )
            rows.append((T if T_world_room is None else T_world_room @ T).ravel())
        np.savetxt(folder / "poses.txt", rows)
        np.savetxt(folder / "K.txt", K)
        return folder

    return write


def link_folder(source: Path, target: Path, names: Sequence[str]) -> Path:
    """`target` with links to the named files of `source`."""
    target.mkdir(parents=True)
    for name in names:
        (target / name).symlink_to(source / name)
    return target


@pytest.fixture
def few_frames(shared: Callable[[str], Path], tmp_path: Path) -> Callable[..., Path]:
    """Links four frames of the real kitchen, with the given kinds of files, into a new folder."""

    def link(*suffixes: str, extra: Sequence[str] = ()) -> Path:
        names = [f"frame-{n:06d}{s}" for n in (0, 240, 768, 912) for s in suffixes]
        return link_folder(shared("data/rgbd/redkitchen"), tmp_path / "kitchen", [*names, *extra])

    return link


@pytest.fixture
def write_json(tmp_path: Path) -> Callable[[Path, object], Path]:
    """Writes JSON and returns the path."""

    def write(path: Path, value: object) -> Path:
        path.write_text(json.dumps(value), encoding="utf-8")
        return path

    return write


# A network small enough to write by hand: protocol buffer fields of onnx.proto3 by their numbers.


def _varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _value_info(name: str, shape: Sequence[int | str], kind: int) -> bytes:
    dims = b"".join(_bytes(1, _number(1, d) if isinstance(d, int) else _bytes(2, d)) for d in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, kind) + _bytes(2, dims)))


def _onnx(inputs, outputs, metadata):
    kinds = {"float32": 1, "int64": 7}
    graph = b""
    for name, value in outputs.items():
        tensor = b"".join(_number(1, d) for d in value.shape)
        tensor += _number(2, kinds[value.dtype.name]) + _bytes(8, f"{name}_value")
        tensor += _bytes(9, value.tobytes())
        node = _bytes(1, f"{name}_value") + _bytes(2, name) + _bytes(4, "Identity")
        graph += _bytes(1, node) + _bytes(5, tensor)
        graph += _bytes(12, _value_info(name, value.shape, kinds[value.dtype.name]))
    graph += _bytes(2, "g")
    for name, (shape, kind) in inputs.items():
        graph += _bytes(11, _value_info(name, shape, kind))
    model = _number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 17))
    for key, text in metadata.items():
        model += _bytes(14, _bytes(1, key) + _bytes(2, text))
    return model


@pytest.fixture
def write_network(tmp_path: Path) -> Callable[..., Path]:
    """Writes an ONNX network that answers the same `outputs` to every image."""

    def write(outputs, *, name="written.onnx", inputs=None, metadata=None):
        path = tmp_path / name
        image = {"image": ((1, 3, 100, 100), 1)}
        path.write_bytes(_onnx(inputs or image, outputs, metadata or {}))
        return path

    return write
