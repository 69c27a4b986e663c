"""Values of a recording's depth, in some of its images: no return, other bytes, whole metres."""

from __future__ import annotations

import contextlib
import logging
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics
from perception.no_return import Constant, UnmovedValues, told
from perception.sources.listing import RecordingListing

SAMPLED: Final = 16  # images, spread evenly, that are looked through
ROUGHER: Final = 10.0  # times as large steps between pixels where bytes are exchanged
FEW_VALUES: Final = 3  # of an image, which has no others, of so many images one after the other
LINES: Final = 8  # groups of rows with depth between empty ones, ...
THIN: Final = 3  # ... of so many rows at most, in the mean
FEW_SHARE: Final = 0.9  # of the pixels of such an image

_log = logging.getLogger(__name__)


def no_return_of(
    name: str, listing: RecordingListing, camera: Intrinsics, depth_scale: float, *, tell: bool
) -> tuple[Constant, ...]:
    """The values of a recording's depth that mean no return; a line names them.

    Args:
        name: Name of the recording.
        listing: Its images.
        camera: The camera of depth.
        depth_scale: Units a metre.
        tell: Whether the line is a warning, and depth is refused whose bytes are exchanged, or
            which is in whole metres (RecordingError).
    """
    entries = listing.entries
    unmoved, known, whole = UnmovedValues(), dict[str, Constant](), 0
    exchanged = lines = 0
    for entry in entries[:: max(1, len(entries) // SAMPLED)]:
        with contextlib.suppress(RecordingError):  # told where the frame is read
            depth = entry.depth.depth(depth_scale)
            K = camera.fitted(depth.shape[1], depth.shape[0]).K
            found = unmoved.add(depth, K, entry.T_world_cam)
            exchanged += _bytes_exchanged(depth, depth_scale)
            lines += _in_lines(depth)
            few = sum(one.share for one in found) >= FEW_SHARE * np.isfinite(depth).mean()
            whole = whole + 1 if len(found) >= FEW_VALUES and few else 0
            for one in found:
                if not one.measurable:
                    known.setdefault(f"{one.value:.3g}", one)
    if exchanged >= FEW_VALUES and tell:
        raise RecordingError(
            f"{name}: the two bytes of its depth are exchanged, as where is_bigendian is "
            "wrong; the other byte order would work, or --no-check"
        )
    if lines >= FEW_VALUES and tell:
        raise RecordingError(
            f"{name}: its depth lies in thin lines with empty rows between them, as a lidar's that "
            "are projected into the image; depth that is interpolated between them would work"
        )
    if whole >= FEW_VALUES and tell:
        raise RecordingError(
            f"{name}: its depth has a handful of values only, as whole metres have; "
            "depth in millimetres, floats in metres, or --no-check for flat scenes would work"
        )
    known |= {f"{one.value:.3g}": one for one in unmoved.found}
    if known:
        _log.log(
            logging.WARNING if tell else logging.INFO,
            "%s: depth of %s is taken for no return: no surface is shared by so many pixels",
            name,
            told(known.values()),
        )
    return tuple(known.values())


def _in_lines(depth: NDArray[np.float32]) -> bool:
    """Whether depth lies in lines of few rows."""
    shown = np.asarray(np.isfinite(depth).any(axis=1))
    groups = int((shown[1:] & ~shown[:-1]).sum())
    return groups >= LINES and int(shown.sum()) <= THIN * groups


def _bytes_exchanged(depth: NDArray[np.float32], depth_scale: float) -> bool:
    """Whether 16-bit depth is far smoother with its bytes exchanged."""
    with np.errstate(over="ignore"):
        units = np.nan_to_num(depth * np.float32(depth_scale), posinf=0).round()
    if units.max(initial=0) > 65535:
        return False
    raw = units.astype(np.uint16)
    both = (raw[:, 1:] > 0) & (raw[:, :-1] > 0)
    steps = [np.abs(np.diff(a.astype(np.int32)))[both] for a in (raw, raw.byteswap())]
    return bool(both.any()) and float(steps[1].mean()) < steps[0].mean() / ROUGHER
