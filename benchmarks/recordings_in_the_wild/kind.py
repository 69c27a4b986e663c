"""A kind of recording, and what may become of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.recordings_in_the_wild import containers as to
from benchmarks.recordings_in_the_wild.folders import Folder
from benchmarks.recordings_in_the_wild.robot import Change, Shot

OfShots = Callable[[Sequence[Shot]], Change]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of recording."""

    name: str
    container: to.Container = to.mcap_ros2
    change: tuple[Change, ...] = ()
    poses: OfShots | None = None  # in place of tf
    remedy: tuple[str, ...] = ()  # options that make a refused one work; {folder} is the plain one
    said: str = ""  # what its line must say (a regular expression); default: the remedy's options
    colour_as_is: bool = True  # whether colour is that of the plain recording
    turned: bool = False  # images are turned, so their pixels are not compared
    holes: bool = False  # depth has fewer pixels, so things may be elsewhere
    first: int = 0  # frame that is its first, where its stamps count from zero
    hopeless: bool = False  # nothing but other data can help; a line must say so
    folder: Folder | None = None  # a layout of files in place of a bag
    live: str = ""  # encoding in which a Foxglove server sends it, for `live`

    @property
    def frames_only(self) -> bool:
        """Whether only the frames are compared."""
        return self.turned or self.holes

    @property
    def line(self) -> str:
        """Regular expression of its line."""
        return self.said or ".*".join(word for word in self.remedy if word.startswith("--"))
