"""RVL, run length and variable length coding of 16-bit depth images.

A. D. Wilson: Fast Lossless Depth Image Compression, ACM ISS 2017. The stream is made of 4-bit
groups, eight to a little-endian word of 32 bits, the highest first. A number is written in groups
of three bits, the lowest first; the fourth bit says that more follow. In turns come how many pixels
are 0, how many are not, and of the latter each one's difference to the one before, zigzag coded.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError

GROUPS: Final = 11  # of a number of 32 bits
#: [bytes] a pixel: 6 groups for its difference, 2 for the lengths of runs as short as it
MAX_BYTES_PER_PIXEL: Final = 4


def decode_rvl(data: NDArray[np.uint8], pixels: int, where: str) -> NDArray[np.uint16]:
    """(pixels,) depth of a stream (n,) of bytes.

    Raises RecordingError, beginning with `where`, where it does not hold as many.
    """
    numbers = _numbers(data[: MAX_BYTES_PER_PIXEL * (pixels + 2)], where)
    runs: list[tuple[int, int, int]] = []  # of pixels that are not 0: first, count, first's number
    place, filled = 0, 0
    while filled < pixels and place + 2 <= len(numbers):
        zeros, count = int(numbers[place]), int(numbers[place + 1])
        runs.append((filled + zeros, count, place + 2))
        filled += zeros + count
        place += 2 + count
    if filled > pixels:
        raise RecordingError(f"{where}: RVL depth does not end with its {pixels} pixels")
    if filled < pixels or place > len(numbers):
        raise RecordingError(f"{where}: RVL depth is cut short before its {pixels} pixels")
    first, counts, at = np.array(runs, np.int64).reshape(-1, 3).T
    along = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    coded = numbers[np.repeat(at, counts) + along]
    depth = np.zeros(pixels, np.uint16)
    depth[np.repeat(first, counts) + along] = np.cumsum((coded >> 1) ^ -(coded & 1)) & 0xFFFF
    return depth


def _numbers(data: NDArray[np.uint8], where: str) -> NDArray[np.int64]:
    """All numbers of a stream; zeros may follow that fill its last word."""
    pairs = data[: len(data) // 4 * 4].reshape(-1, 4)[:, ::-1].ravel()
    groups = np.stack([pairs >> 4, pairs & 15], axis=1).ravel()
    ends = np.flatnonzero(groups < 8)
    if not len(ends):
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts + 1
    if lengths.max() > GROUPS:
        raise RecordingError(f"{where}: RVL depth holds a number of more than 32 bits")
    digits = np.arange(ends[-1] + 1) - np.repeat(starts, lengths)
    bits = (groups[: ends[-1] + 1] & 7).astype(np.int64) << 3 * digits
    numbers: NDArray[np.int64] = np.add.reduceat(bits, starts)
    return numbers
