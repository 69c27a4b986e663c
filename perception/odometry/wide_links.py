"""Wide links: motions between key frames that are far apart, by SIFT features and depth.

SIFT matches views that ORB and optical flow cannot, for ten times the time, so it is used only
where the camera is lost, and between pieces.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from perception.odometry.features import Features, Image, ScaleFeatureDetector
from perception.odometry.relative_motion import RelativeMotion, confirmed_motion

MIN_SHARE: Final = 0.2  # of the matches that have to agree on the motion
AGREES: Final = 0.9  # of the depth of two views that show one scene
OVERLAP: Final = 0.2  # of their depth that both show
MAX_IMAGES: Final = 8  # newest key frames whose images are kept


@dataclass(slots=True)
class WideLinks:
    """SIFT features of key frames, computed where they are first needed."""

    _images: dict[int, Image] = field(default_factory=dict)  # of the newest key frames
    _features: dict[int, Features] = field(default_factory=dict)  # by key frame
    _last: tuple[Image, Features] | None = None
    _detector: ScaleFeatureDetector = field(default_factory=ScaleFeatureDetector)

    def keep_recent(self, key: int, image: Image) -> None:
        """Keep the image of a new key frame, and forget all of an old one."""
        self._images[key] = image
        for old in [number for number in self._images if number <= key - MAX_IMAGES]:
            del self._images[old]
            self._features.pop(old, None)

    def keep(self, key: int, image: Image) -> None:
        """Keep the features of a key frame."""
        self._features[key] = replace(self._features_of(image), grey=np.zeros((0, 0), np.uint8))

    def motion(self, key: int, image: Image) -> RelativeMotion | None:
        """The motion from a key frame to an image that surely shows the same; None: not found."""
        if key not in self._features:
            if key not in self._images:
                return None
            self._features[key] = self._features_of(self._images[key])
        return confirmed_motion(
            self._features[key],
            self._features_of(image),
            image,
            agrees=AGREES,
            overlap=OVERLAP,
            min_share=MIN_SHARE,
        )

    def _features_of(self, image: Image) -> Features:
        if self._last is None or self._last[0] is not image:
            self._last = image, self._detector.features(image)
        return self._last[1]
