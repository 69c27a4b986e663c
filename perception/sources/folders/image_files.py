"""Image files: colour and depth decoded, checked, and turned upright; their entries."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_bytes
from perception.camera.gravity_alignment import (
    turned_camera,
    turned_image,
    turned_poses,
    upright_turns,
)
from perception.camera.image_decoding import PNG, check_png, decode_image, metres
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import LOST, Pose
from perception.number_tables import check_pointer
from perception.sources.listing import DAMAGED_SHARE, FrameEntry, RecordingListing, StoredImage

COLOUR_SUFFIXES = (".jpg", ".jpeg", ".png")
DEPTH_SUFFIXES = (".png", ".npy", ".tif", ".tiff", ".pgm", ".pfm")
_NPY = b"\x93NUMPY"
_OTHERS = (_NPY, b"II*\0", b"MM\0*", b"P5", b"Pf")  # NPY, TIFF, PGM, PFM
_COUNTED = re.compile(r"(\d+)-\d{9,}")
_MAX_HEADER = 10_000  # [bytes] of an NPY file
_TAIL = 4096  # bytes: some cameras write notes after the end-of-image marker
_log = logging.getLogger(__name__)


def check_image_file(path: Path) -> None:
    """Raise RecordingError for a missing, truncated or damaged PNG or JPEG, without decoding it.

    A PNG carries a checksum with each of its chunks; a JPEG has only its end-of-image marker. Other
    formats have neither.
    """
    data = _bytes_of(path).tobytes()
    if data.startswith(PNG):
        check_png(data, str(path))
    elif data.startswith(_OTHERS) and path.suffix.lower() in DEPTH_SUFFIXES:
        return
    elif not data.startswith(b"\xff\xd8"):
        check_pointer(data, path, "neither PNG nor JPEG")
        raise RecordingError(f"{path} is neither PNG nor JPEG ({len(data)} bytes)")
    elif b"\xff\xd9" not in data[-_TAIL:]:
        raise RecordingError(f"{path} is truncated after {len(data)} bytes")


def decoded(path: Path, flags: int) -> NDArray[Any]:
    """The image by the `flags` of cv2.imdecode; raises RecordingError for an unreadable one."""
    data = _bytes_of(path)
    check_pointer(data[:100].tobytes(), path)
    return decode_image(data, flags, str(path))


def _bytes_of(path: Path) -> NDArray[np.uint8]:
    try:
        return np.frombuffer(read_bytes(path), np.uint8)
    except OSError as error:
        raise RecordingError(f"cannot read image {path}: {error.strerror}") from error


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image of a recording that is a file."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    def check(self) -> None:
        """Raise RecordingError for a missing, truncated or damaged file."""
        check_image_file(self.path)

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return read_colour(self.path)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return, from a 16-bit image with `depth_scale` units a metre."""
        return read_depth(self.path, depth_scale)


def read_colour(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return np.ascontiguousarray(decoded(path, flags)[:, :, ::-1]).astype(np.uint8, copy=False)


def read_depth(path: Path, depth_scale: float) -> NDArray[np.float32]:
    """(H, W) [m], nan = no return, from 16 bits with `depth_scale` units a metre, or floats."""
    is_array = path.suffix.lower() == ".npy"
    raw = _array(path) if is_array else decoded(path, cv2.IMREAD_UNCHANGED)
    if raw.ndim != 2 or raw.dtype.kind not in "iuf" or raw.dtype.itemsize < 2:
        raise RecordingError(
            f"{path}: depth must be one 16-bit channel, or floats in metres (NPY, TIFF), got "
            f"{raw.dtype} of shape {raw.shape}"
        )
    return metres(raw, depth_scale)


def _array(path: Path) -> NDArray[Any]:
    """The one array of an NPY file, without pickles; raises RecordingError."""
    data = _bytes_of(path)
    file = io.BytesIO(data[:_MAX_HEADER].tobytes())
    try:
        version = np.lib.format.read_magic(file)
        read = {(1, 0): np.lib.format.read_array_header_1_0}[version]
        shape, fortran, kind = read(file, max_header_size=_MAX_HEADER)
        values = data[file.tell() :].view(kind)  # as many as there are, whatever the header says
        return values.reshape(shape, order="F" if fortran else "C").squeeze()
    except (ValueError, TypeError, SyntaxError, KeyError, TokenError) as error:
        raise RecordingError(f"{path} is no NPY file of depth: {error}") from error


def entry_of(colour: Path, depth: Path, T_world_cam: Pose, stamp: float) -> FrameEntry:
    """Entry of two image files; the frame is called as its colour, NAME.jpg or NAME.color.jpg."""
    name = colour.stem.removesuffix(".color")
    return FrameEntry(name, ImageFile(colour), ImageFile(depth), T_world_cam, stamp)


def with_poses(
    entries: Iterable[FrameEntry], pose_of: Callable[[FrameEntry], Pose | None]
) -> tuple[FrameEntry, ...]:
    """The entries with the poses (4, 4) found for them; LOST where there is none."""
    found = ((entry, pose_of(entry)) for entry in entries)
    return tuple(replace(entry, T_world_cam=LOST if T is None else T) for entry, T in found)


def posed(entries: Sequence[FrameEntry], path: Path) -> tuple[FrameEntry, ...]:
    """The entries whose pose is not LOST; a line tells of the others."""
    found = tuple(entry for entry in entries if np.isfinite(entry.T_world_cam).all())
    if 0 < len(found) < len(entries):
        lost = len(entries) - len(found)
        _log.warning("%s: %d of %d images have no pose and are skipped", path, lost, len(entries))
    return found


@dataclass(frozen=True, slots=True)
class ChangedImage:
    """An image that is read in another way than it is stored."""

    image: StoredImage

    def __str__(self) -> str:
        return str(self.image)

    def check(self) -> None:
        """As the image's own."""
        self.image.check()

    def colour(self) -> NDArray[np.uint8]:
        """As the image's own."""
        return self.image.colour()


@dataclass(frozen=True, slots=True)
class TurnedImage(ChangedImage):
    """An image turned counter-clockwise by quarters."""

    turns: int

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return turned_image(self.image.colour(), self.turns)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; raises RecordingError for an unreadable image."""
        return turned_image(self.image.depth(depth_scale), self.turns)


@dataclass(frozen=True, slots=True)
class DisparityImage(ChangedImage):
    """A depth image that holds disparities [px] of the pixels of `camera`."""

    camera: Intrinsics
    baseline: float  # [m]

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; `depth_scale` [units a pixel] is that of 16-bit images."""
        pixels = self.image.depth(depth_scale)
        focal = self.camera.fitted(pixels.shape[1], pixels.shape[0]).fx
        with np.errstate(divide="ignore"):
            found = np.where(pixels > 0, focal * self.baseline / pixels, np.nan)
        return np.asarray(found, np.float32)


def turned_upright(listing: RecordingListing, up: NDArray[np.float64]) -> RecordingListing:
    """A phone's listing, turned by quarters until `up` (3,) is at the top of most images.

    Its camera has no distortion, and images of known size.
    """
    poses = (e.T_world_cam for e in listing.entries)
    turns = int(upright_turns([T for T in poses if np.isfinite(T).all()], up).argmax())
    entries = tuple(
        replace(
            e,
            colour=TurnedImage(e.colour, turns),
            depth=TurnedImage(e.depth, turns),
            T_world_cam=turned_poses(e.T_world_cam, turns),
        )
        for e in listing.entries
    )
    camera = None if listing.camera is None else turned_camera(listing.camera, turns)
    return replace(listing, entries=entries, camera=camera, up=up)


def files_in(folder: Path, pattern: str = "*") -> list[Path]:
    """Files of a folder by name, without hidden ones, which systems leave behind (._NAME)."""
    return sorted(path for path in folder.glob(pattern) if not path.name.startswith("."))


def pairs_by_number(
    colour: dict[int, Path], depth: dict[int, Path], where: Path
) -> dict[int, tuple[Path, Path]]:
    """Colour and depth image by number; one that is missing has the name that it would have.

    Where one of the two has at most half of the other's numbers, it was recorded less often: only
    the numbers of both are given, with a line. Raises RecordingError where there are none of one.
    """
    if not colour or not depth:
        raise RecordingError(f"{where} has no {'depth' if colour else 'colour'} images")
    both = colour.keys() & depth.keys()
    if 0 < 2 * len(both) <= max(len(colour), len(depth)):
        tell_unpaired(where, len(colour), len(depth), len(both), "of the same number")
        return {n: (colour[n], depth[n]) for n in sorted(both)}
    some = next(iter(colour.values())), next(iter(depth.values()))
    return {
        n: (colour.get(n) or _named_like(some[0], n), depth.get(n) or _named_like(some[1], n))
        for n in sorted(colour.keys() | depth.keys())
    }


def tell_unpaired(where: Path, colour: int, depth: int, pairs: int, alike: str) -> None:
    """Warn of images that have no partner, by how many there are."""
    if pairs < max(colour, depth):
        text = "%s: %d colour and %d depth images make %d pairs %s; the others are left out"
        _log.warning(text, where, colour, depth, pairs, alike)


def _named_like(path: Path, number: int) -> Path:
    """The path with another number as the last of its name."""
    name = re.sub(r"\d+(?=\D*$)", lambda old: f"{number:0{len(old[0])}d}", path.stem, count=1)
    return path.with_name(name + path.suffix)


def images_by_number(
    folder: Path, suffixes: Iterable[str] = COLOUR_SUFFIXES, prefix: str = ""
) -> dict[int, Path]:
    """Images of `folder` keyed by the last number in their name, in numeric order.

    Those whose name begins with `prefix`. Of a frame's number and its time, as SUN3D and Redwood
    have them (`0000012-000000399960`), the first counts.

    Raises RecordingError where there is no image, a name without number, or one number twice.
    """
    found: dict[int, Path] = {}
    nameless: list[Path] = []
    wanted = tuple(suffixes)
    for path in files_in(folder):
        if path.suffix.lower() not in wanted or not path.name.startswith(prefix):
            continue
        counted = _COUNTED.fullmatch(path.stem)
        digits = [counted[1]] if counted else re.findall(r"\d+", path.stem)
        if not digits:
            nameless.append(path)
            continue
        if int(digits[-1]) in found:
            raise RecordingError(f"{path} and {found[int(digits[-1])].name} have the same number")
        found[int(digits[-1])] = path
    if len(nameless) > DAMAGED_SHARE * len(found):
        raise RecordingError(f"{nameless[0]}: image names carry their frame number")
    if nameless:
        _log.warning("%s has no frame number in its name and is left out", nameless[0])
    if not found:
        others = sorted({p.suffix for p in folder.iterdir() if p.suffix})
        beside = f", but {', '.join(others[:5])} files" if others else ""
        depth = "; depth is read from 16-bit PNG, PGM, TIFF, or NPY, PFM, TIFF of floats in metres"
        hint = depth if wanted == DEPTH_SUFFIXES else ""
        raise RecordingError(f"no images ({', '.join(wanted)}) in {folder}{beside}{hint}")
    return dict(sorted(found.items()))
