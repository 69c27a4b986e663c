"""Kinds of folders by simulators, apps, SLAM programs, and people who edit lists by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.recordings_in_the_wild import folders as f
from benchmarks.recordings_in_the_wild import image_changes as i
from benchmarks.recordings_in_the_wild.kind import Kind
from benchmarks.recordings_in_the_wild.robot import COLOUR, Shot
from perception.camera.poses import quaternion_from_pose

More = Callable[[Sequence[Shot], Path], object]
POSED: Final = "pose/{n:06d}.txt"


def text(name: str, of: Callable[[Shot], str], begin: str = "", **camera: float) -> More:
    """A file with a line a frame, and the camera with other numbers."""

    def more(shots: Sequence[Shot], folder: Path) -> None:
        f.write(folder / name, begin + "".join(map(of, shots)))
        f.write(folder / "intrinsics.json", f.camera(shots[0], **camera))

    return more


def camera(**numbers: float) -> More:
    """The camera with other numbers."""
    return lambda shots, folder: f.write(folder / "intrinsics.json", f.camera(shots[0], **numbers))


def edited(make: f.Folder, name: str, how: Callable[[list[str]], list[str]]) -> f.Folder:
    """A folder one of whose lists somebody edited."""

    def layout(shots: Sequence[Shot], scratch: Path) -> Path:
        file = make(shots, scratch) / name
        file.write_text("".join(how(file.read_text().splitlines(keepends=True))))
        return file.parent

    return layout


def spoilt(make: f.Folder, **files: bytes) -> f.Folder:
    """A folder with files (`rgb__000030` is rgb/000030.png) that are cut to so many bytes."""

    def layout(shots: Sequence[Shot], scratch: Path) -> Path:
        folder = make(shots, scratch)
        for name, end in files.items():
            path = folder / (name.replace("__", "/") + ".png")
            path.write_bytes(path.read_bytes()[:5000] if end else b"")
        return folder

    return layout


def linked(shots: Sequence[Shot], scratch: Path) -> Path:
    """A folder of links, with spaces and umlauts in its name."""
    made = f.images(pose=POSED)(shots, scratch / "disk")
    folder = scratch / "Küche 2 (neu)"
    folder.mkdir()
    for path in made.iterdir():
        (folder / path.name).symlink_to(path)
    return folder


def euroc_row(shot: Shot) -> str:
    """A line of EuRoC and Kimera: nanoseconds, position, w first."""
    x, y, z, w = quaternion_from_pose(shot.T_map_cam)
    numbers = (*shot.T_map_cam[:3, 3], w, x, y, z)
    return ",".join([str(shot.stamp), *(f"{n:.9f}" for n in numbers)]) + "\n"


def disparity(shot: Shot) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """Disparity of a stereo camera of 7.5 cm, in 1/16 px."""
    pixels = shot.K[0, 0] * 0.075 / np.where(shot.depth > 0, shot.depth, np.inf)
    return np.round(np.nan_to_num(pixels) * 16).astype(np.uint16)


def lines_of_lidar(shot: Shot) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """Every eighth row of depth, as of a lidar in the image."""
    depth = f.MILLIMETRES(shot)
    rows = np.arange(len(depth)) % 8 == 0
    return np.where(rows[:, None], depth, np.uint16(0))


def rotated_bits(shot: Shot) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """Millimetres whose three lowest bits went to the other end, as SUN3D has them."""
    depth = f.MILLIMETRES(shot)
    return (depth << np.uint16(3)) | (depth >> np.uint16(13))


def sun3d(shots: Sequence[Shot], scratch: Path) -> Path:
    """Files of SUN3D: the last number of a name is its time."""
    number = "{n:07d}-{n:012d}"
    made = f.images(f"image/{number}.jpg", f"depth/{number}.png", rotated_bits)(shots, scratch)
    f.write(made / "intrinsics.txt", f.numbers_of(shots[0].K))
    f.write(made / "extrinsics/1.txt", "".join(f.numbers_of(s.T_map_cam[:3]) for s in shots))
    return made


def leaping(lines: list[str]) -> list[str]:
    """Stamps of the second half are an hour later."""
    half = len(lines) // 2
    late = [" ".join([f"{float(x.split()[0]) + 3600:.6f}", *x.split()[1:]]) for x in lines[half:]]
    return lines[:half] + [f"{line}\n" for line in late]


THIRD_PARTIES: Final = (
    Kind("Habitat, NPY of one channel, far plane 10 m", folder=f.images(
        depth="depth/{n:06d}.npy", pose=POSED,
        of_depth=lambda s: np.where(s.depth > 0, s.depth, np.float32(10))[..., None]),
         said="no return"),
    Kind("SUN3D, rotated bits of depth", folder=f.images(
        of_depth=rotated_bits, pose=POSED), remedy=("--depth-scale", "8000"),
         said="--depth-scale 8000"),
    Kind("disparity as depth", folder=f.images(of_depth=disparity, pose=POSED),
         remedy=("--disparity", "0.075", "--depth-scale", "16"), said="--disparity"),
    Kind("disparity as depth, without poses", folder=f.images(of_depth=disparity), hopeless=True,
         said="contradict|does not|--depth-scale"),
    Kind("rows of a lidar", folder=f.images(of_depth=lines_of_lidar, pose=POSED), hopeless=True,
         said="interpolated between"),
    Kind("SUN3D, as downloaded", folder=sun3d),
    Kind("3RScan, depth in PGM", folder=f.images(
        "frame-{n:06d}.color.jpg", "frame-{n:06d}.depth.pgm", pose="frame-{n:06d}.pose.txt",
        more=f.bundle_fusion)),
    Kind("ETH3D, calibration.txt", folder=f.images(pose=POSED, more=lambda shots, folder: f.write(
        folder / "calibration.txt", "{0[0]} {1[1]} {0[2]} {1[2]}\n".format(*shots[0].K)))),
    Kind("Kimera's traj_vio.csv", folder=f.images(
        "rgb/{stamp}.png", "depth/{stamp}.png", more=text(
            "traj_vio.csv", euroc_row, "#timestamp,x,y,z,qw,qx,qy,qz\n"))),
    Kind("Semantic-NeRF, traj_w_c.txt", folder=f.images(
        "rgb/rgb_{n}.png", "depth/depth_{n}.png",
        more=text("traj_w_c.txt", lambda s: f.one_row(s.T_map_cam)))),
    Kind("poses column by column", folder=f.images(
        more=text("poses.txt", lambda s: f.one_row(s.T_map_cam.T))), hopeless=True,
         said="column|transposed|last row"),
    Kind("all poses the same", folder=f.images(pose=POSED, of_pose=lambda T: np.eye(4)),
         remedy=("--poses", "estimate"), said="--poses estimate", holes=True),
    Kind("principal point outside the image", folder=f.images(pose=POSED, more=camera(cx=900.0)),
         remedy=("--intrinsics", "{folder}/intrinsics.json")),
    Kind("camera of images twice as large, without their size", folder=f.images(
        pose=POSED, more=lambda shots, folder: f.write(folder / "K.txt", "\n".join(
            " ".join(f"{x:.4f}" for x in row) for row in np.diag([2, 2, 1]) @ shots[0].K))),
         remedy=("--intrinsics", "{folder}/intrinsics.json")),
    Kind("colour in blue, green, red", folder=f.images(
        of_colour=lambda s: s.rgb[:, :, ::-1], pose=POSED), said="--bgr"),
    Kind("blue, green, red in a bag that says rgb8", change=(
        i.each(COLOUR, lambda m: i.packed(m, i.rgb_of(m)[:, :, ::-1], "rgb8")),), said="--bgr"),
    Kind("names in capitals", folder=f.images("RGB/{n:06d}.PNG", "Depth/{n:06d}.PNG", pose=POSED),
         hopeless=True, said="colour in rgb/"),
    Kind("colour and depth in one folder", folder=f.images(
        "{n:06d}_rgb.png", "{n:06d}_depth.png"), hopeless=True, said="colour in rgb/"),
    Kind("depth in PGM", folder=f.images(depth="depth/{n:06d}.pgm", pose=POSED)),
    Kind("depth in PFM", folder=f.images(
        depth="depth/{n:06d}.pfm", of_depth=lambda s: np.nan_to_num(s.depth), pose=POSED)),
    Kind("depth in 16-bit TIFF", folder=f.images(depth="depth/{n:06d}.tiff", pose=POSED)),
    Kind("links, in a folder with spaces and umlauts", folder=linked),
    Kind("empty and cut files", folder=spoilt(
        f.images(pose=POSED), rgb__000012=b"", depth__000030=b"cut"), said="left out", holes=True),
    Kind("TUM, lines unsorted", folder=edited(f.tum(), "rgb.txt", lambda x: x[::-1])),
    Kind("TUM, poses unsorted", folder=edited(f.tum(), "groundtruth.txt", lambda x: x[::-1])),
    Kind("TUM, each line twice", folder=edited(
        f.tum(), "rgb.txt", lambda x: [one for line in x for one in (line, line)])),
    Kind("TUM, a gap of 20 frames in depth", folder=edited(
        f.tum(), "depth.txt", lambda x: x[:15] + x[35:]), said="left out", holes=True),
    Kind("TUM, colour's clock leaps by an hour", folder=edited(f.tum(), "rgb.txt", leaping),
         said="left out|--tolerance", holes=True),
    Kind("TUM, poses leap by an hour", folder=edited(f.tum(), "groundtruth.txt", leaping),
         said="no pose", holes=True),
)  # fmt: skip
