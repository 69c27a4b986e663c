"""ArUco and AprilTag marks in pictures."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any, Final

import cv2
import numpy as np

from kg.model.errors import ModelError, RecordingError
from perception.camera.image_decoding import decode_image

_PREFIX: Final = "DICT_"


def marker_name(text: str) -> str:
    """The mark of a text such as ``4x4_50/17`` or ``apriltag_36h11/3``, in this form.

    Raises ModelError for an unknown dictionary or number.
    """
    dictionary, _, number = text.strip().lower().partition("/")
    if dictionary not in dictionaries():
        raise ModelError(f"no marks {text!r}; {', '.join(dictionaries())} with a number, as in "
                         "4x4_50/17, would work")  # fmt: skip
    count = len(_detector(dictionary).getDictionary().bytesList)
    if not number.isascii() or not number.isdecimal() or int(number) >= count:
        raise ModelError(f"marks of {dictionary} have numbers from 0 to {count - 1}, got {text!r}")
    return f"{dictionary}/{int(number)}"


def markers_in(picture: bytes, wanted: Iterable[str]) -> set[str]:
    """Marks of the `wanted` dictionaries in a JPEG or PNG, as in ``4x4_50/17``."""
    try:
        grey = decode_image(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE, "the picture")
    except RecordingError:
        return set()
    found = set()
    for dictionary in wanted:
        _, numbers, _ = _detector(dictionary).detectMarkers(grey)
        found |= {f"{dictionary}/{int(n)}" for n in (() if numbers is None else numbers.ravel())}
    return found


@cache
def dictionaries() -> tuple[str, ...]:
    """Names of the known dictionaries of marks."""
    names = (name for name in dir(cv2.aruco) if name.startswith(_PREFIX))
    return tuple(sorted({name.removeprefix(_PREFIX).lower() for name in names}))


@cache
def _detector(dictionary: str) -> Any:
    by_name = {name.lower(): getattr(cv2.aruco, name) for name in dir(cv2.aruco)}
    known = cv2.aruco.getPredefinedDictionary(by_name[f"{_PREFIX.lower()}{dictionary}"])
    return cv2.aruco.ArucoDetector(known, cv2.aruco.DetectorParameters())
