"""Images that came as messages, and those of a topic that wait to be used."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.image_decoding import metres
from perception.sources.bags.bag_file import RawMessage, decoded
from perception.sources.ros.headers import NANOSECONDS
from perception.sources.ros.image_messages import colour_image, depth_image

HELD: Final = 64  # messages of a topic that wait, ...
HELD_BYTES: Final = 1 << 27  # ... and their size [bytes]


@dataclass(frozen=True, slots=True)
class LiveDecoder:
    """Decoder of the messages of one connection."""

    address: str
    is_ros1: bool

    def decoded(self, raw: RawMessage) -> Any:
        """The message with its fields; raises RecordingError."""
        return decoded(raw, self.is_ros1, self.address)


@dataclass(frozen=True, slots=True)
class LiveImage:
    """An image that came as a message."""

    raw: RawMessage
    decoder: LiveDecoder
    stamp: int  # [ns]
    came: float  # [s] of time.monotonic()

    def __str__(self) -> str:
        return f"{self.decoder.address}, {self.raw.topic} at {self.id}"

    @property
    def id(self) -> str:
        """Its stamp as text."""
        return f"{self.stamp // NANOSECONDS}.{self.stamp % NANOSECONDS:09d}"

    @property
    def seconds(self) -> float:
        """Its stamp [s]."""
        return self.stamp / NANOSECONDS

    def check(self) -> None:
        """Nothing: a message has come whole or not at all."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return colour_image(self.decoder.decoded(self.raw), str(self))

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; `depth_scale` [units a metre] is that of 16-bit images."""
        return metres(depth_image(self.decoder.decoded(self.raw), str(self)), depth_scale)


class HeldImages:
    """The latest images of a topic, bounded in number and size."""

    def __init__(self) -> None:
        self.images = deque[LiveImage]()
        self.size = 0  # [bytes]

    def add(self, image: LiveImage) -> None:
        """Add one; the first go where they become too many, and all where time went back."""
        if self.images and image.stamp < self.images[-1].stamp - NANOSECONDS:
            self.images.clear()
            self.size = 0
        self.images.append(image)
        self.size += len(image.raw.data)
        while len(self.images) > 1 and (len(self.images) > HELD or self.size > HELD_BYTES):
            self.drop(self.images[0])

    def drop(self, image: LiveImage) -> None:
        """Drop one."""
        self.images.remove(image)
        self.size -= len(image.raw.data)

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Stamps [s] (n,)."""
        return np.array([image.seconds for image in self.images])
