"""Folders as data sets, apps and other programs lay them out, with the frames of a recording."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.recordings_in_the_wild.robot import Shot, millimetres
from perception.camera.poses import Pose, quaternion_from_pose

Folder = Callable[[Sequence[Shot], Path], Path]
Depth = Callable[[Shot], NDArray[Any]]
GRID: Final = 3  # images are numbered by threes: 30 numbers a second
OPENGL: Final = np.diag([1.0, -1.0, -1.0, 1.0])


def in_units(scale: float) -> Depth:
    """16-bit depth with so many units a metre."""
    return lambda s: np.round(np.nan_to_num(s.depth) * scale).astype(np.uint16)


MILLIMETRES: Final = in_units(1000)


def noise_at(distance: float) -> Depth:
    """Floats [m] with a noisy distance where nothing returns."""
    rng = np.random.default_rng(0)
    far = lambda s: rng.normal(distance, 0.03, s.depth.shape).astype(np.float32)  # noqa: E731
    return lambda s: np.where(np.isfinite(s.depth), s.depth, far(s))


def thumbnails(depth: Depth, width: int, height: int) -> Depth:
    """Depth of another size."""
    return lambda s: cv2.resize(depth(s), (width, height), interpolation=cv2.INTER_NEAREST)


def numbers_of(T: Pose) -> str:
    """A matrix in four rows."""
    return "\n".join(" ".join(f"{x:.9f}" for x in row) for row in T) + "\n"


def one_row(T: Pose) -> str:
    """A matrix in one row."""
    return " ".join(f"{x:.9f}" for x in T.ravel()) + "\n"


def tum_row(shot: Shot) -> str:
    """A pose as TUM's benchmark has it."""
    q = quaternion_from_pose(shot.T_map_cam)
    return " ".join([stamp_of(shot), *(f"{x:.9f}" for x in (*shot.T_map_cam[:3, 3], *q))]) + "\n"


def stamp_of(shot: Shot) -> str:
    """Stamp [s] in a name."""
    return f"{shot.stamp / 1e9:.6f}"


def write(path: Path, content: NDArray[Any] | str | bytes | dict[str, Any]) -> Path:
    """Write an image, by the suffix, or text; colour is RGB."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, dict):
        content = json.dumps(content)
    if isinstance(content, str):
        content = content.encode()
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif path.suffix == ".npy":
        np.save(path, content)
    else:
        bgr = (
            content[:, :, [2, 1, 0, *range(3, content.shape[2])]] if content.ndim == 3 else content
        )
        assert cv2.imwrite(str(path), np.ascontiguousarray(bgr))
    return path


def camera(shot: Shot, **more: Any) -> dict[str, Any]:
    """intrinsics.json."""
    K, (height, width) = shot.K, shot.depth.shape
    size = {"width": width, "height": height}
    return {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], **size, **more}


def images(
    colour: str = "rgb/{n:06d}.png",
    depth: str = "depth/{n:06d}.png",
    of_depth: Depth = MILLIMETRES,
    of_colour: Callable[[Shot], NDArray[Any]] = lambda s: s.rgb,
    pose: str = "",
    more: Callable[[Sequence[Shot], Path], object] = lambda shots, folder: write(
        folder / "intrinsics.json", camera(shots[0])
    ),
    of_pose: Callable[[Pose], Pose] = lambda T: T,
) -> Folder:
    """Images, and a file of a pose each, by names with their number or stamp; `more` files."""

    def layout(shots: Sequence[Shot], scratch: Path) -> Path:
        folder = scratch / "room"
        for i, shot in enumerate(shots):
            seconds, rest = divmod(shot.stamp + i * 123_457, 10**9)
            names = {"n": i * GRID, "stamp": stamp_of(shot), "ros": f"{seconds}_{rest}"}
            write(folder / colour.format(**names), of_colour(shot))
            write(folder / depth.format(**names), of_depth(shot))
            if pose:
                write(folder / pose.format(**names), numbers_of(of_pose(shot.T_map_cam)))
        more(shots, folder)
        return folder

    return layout


def without(make: Folder, *names: str) -> Folder:
    """A folder without some of its files."""

    def layout(shots: Sequence[Shot], scratch: Path) -> Path:
        folder = make(shots, scratch)
        for name in names:
            (folder / name).unlink()
        return folder

    return layout


def open3d(shots: Sequence[Shot], folder: Path) -> None:
    """The camera as Open3D's reader of Azure Kinect writes it."""
    height, width = shots[0].depth.shape
    matrix = shots[0].K.T.ravel().tolist()
    card = {"width": width, "height": height, "intrinsic_matrix": matrix}
    write(folder / "intrinsic.json", card)


def scannet(shots: Sequence[Shot], folder: Path) -> None:
    """Cameras of ScanNet's exporter, and a pose that was lost."""
    K = np.eye(4)
    K[:3, :3] = shots[0].K
    write(folder / "intrinsic/intrinsic_color.txt", numbers_of(K))
    write(folder / "intrinsic/intrinsic_depth.txt", numbers_of(K))
    write(folder / "pose/15.txt", "-inf -inf -inf -inf\n" * 3 + "0 0 0 1\n")


def replica(shots: Sequence[Shot], folder: Path) -> None:
    """Files of NICE-SLAM's renderings of Replica."""
    write(folder / "traj.txt", "".join(one_row(s.T_map_cam) for s in shots))
    c = camera(shots[0])
    words = {"w": c.pop("width"), "h": c.pop("height")}
    write(folder.parent / "cam_params.json", {"camera": {**words, **c, "scale": 6553.5}})


def bundle_fusion(shots: Sequence[Shot], folder: Path) -> None:
    """info.txt of BundleFusion and ScanNet."""
    K = np.eye(4)
    K[:3, :3] = shots[0].K
    height, width = shots[0].depth.shape
    lines = [f"m_colorWidth = {width}", f"m_colorHeight = {height}", f"m_depthWidth = {width}",
             f"m_depthHeight = {height}", "m_depthShift = 1000",
             f"m_calibrationColorIntrinsic = {one_row(K).strip()}",
             f"m_calibrationDepthIntrinsic = {one_row(K).strip()}"]  # fmt: skip
    write(folder / "info.txt", "\n".join(lines) + "\n")


def neural_rgbd(shots: Sequence[Shot], folder: Path) -> None:
    """Files of Neural RGB-D Surface Reconstruction."""
    write(folder / "poses.txt", "".join(numbers_of(s.T_map_cam @ OPENGL) for s in shots))
    write(folder / "focal.txt", f"{shots[0].K[0, 0]}\n")


def tum(
    colour: str = "rgb/{stamp}.png", *, lists: bool = True, line: str = "\n", begin: str = "",
    associations: str = "", poses: str = "groundtruth.txt",
    stamp: Callable[[Shot], str] = stamp_of, depth: str = "depth/{stamp}.png",
) -> Folder:  # fmt: skip
    """TUM RGB-D; `stamp` is that of a frame in lists and poses."""

    def more(shots: Sequence[Shot], folder: Path) -> None:
        write(folder / "intrinsics.json", camera(shots[0], depth_scale=5000))
        text = begin + "".join(f"{stamp(s)} {tum_row(s).partition(' ')[2]}" for s in shots)
        write(folder / poses, text.replace("\n", line))
        for name, pattern in {"rgb": colour, "depth": depth}.items() if lists else ():
            rows = [
                f"{stamp(s)} {pattern.format(n=i * GRID, stamp=stamp_of(s))}\n"
                for i, s in enumerate(shots)
            ]
            write(folder / f"{name}.txt", (begin + "".join(rows)).replace("\n", line))
        if associations:
            rows = [associations.format(stamp=stamp_of(s)) + "\n" for s in shots]
            write(folder / "associations.txt", "".join(rows))

    return images(colour, depth, in_units(5000), more=more)


def nerfstudio(*, missing: int = 0, **more: Any) -> Folder:
    """nerfstudio's transforms.json with depth."""

    def files(shots: Sequence[Shot], folder: Path) -> None:
        K, (height, width) = shots[0].K, shots[0].depth.shape
        head = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "w": width,
                "h": height, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}  # fmt: skip
        frames = [
            {"file_path": f"images/{n:06d}.png", "depth_file_path": f"depth/{n:06d}.png",
             "transform_matrix": (s.T_map_cam @ OPENGL).tolist()}
            for n, s in zip(range(0, GRID * len(shots), GRID), shots, strict=True)
        ]  # fmt: skip
        write(folder / "transforms.json", {**head, **more, "frames": frames})
        for frame in frames[5 : 5 + missing]:
            (folder / str(frame["file_path"])).unlink()

    return images("images/{n:06d}.png", more=files)


def polycam(shots: Sequence[Shot], folder: Path) -> None:
    """Cameras of Polycam's raw export, in a world with y up."""
    y_up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    for i, s in enumerate(shots):
        T = y_up @ s.T_map_cam @ OPENGL
        rows = {f"t_{r}{c}": float(T[r, c]) for r in range(3) for c in range(4)}
        write(folder / f"keyframes/cameras/{i * GRID:06d}.json", {**camera(s), **rows})


def arkit_scenes(shots: Sequence[Shot], folder: Path) -> None:
    """Files of ARKitScenes."""
    K, (height, width) = shots[0].K, shots[0].depth.shape
    for s in shots:
        text = f"{width} {height} {K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}\n"
        write(folder / f"lowres_wide_intrinsics/42_{stamp_of(s)}.pincam", text)
    rows = []
    for s in shots:
        T = np.linalg.inv(s.T_map_cam)
        turn = cv2.Rodrigues(T[:3, :3])[0].ravel()
        rows.append(" ".join([stamp_of(s), *(f"{x:.9f}" for x in (*turn, *T[:3, 3]))]) + "\n")
    write(folder / "lowres_wide.traj", "".join(rows))


def video(shots: Sequence[Shot], scratch: Path) -> Path:
    """A video beside depth images, without poses."""
    folder = scratch / "room"
    folder.mkdir()
    height, width = shots[0].depth.shape
    out = cv2.VideoWriter(
        str(folder / "rgb.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (width, height)
    )
    for i, s in enumerate(shots):
        for _ in range(GRID):
            out.write(np.ascontiguousarray(s.rgb[:, :, ::-1]))
        write(folder / f"depth/{i * GRID:06d}.png", millimetres(s.depth))
    out.release()
    write(folder / "intrinsics.json", camera(shots[0]))
    return folder


def file_of(name: str, head: bytes) -> Folder:
    """A file of another program that is not read."""
    return lambda shots, scratch: write(scratch / name, head + bytes(4096))
