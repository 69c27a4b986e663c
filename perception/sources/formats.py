"""The formats of recordings, and the one that a path has."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from kg.model.errors import RecordingError, did_you_mean
from kg.model.extensions import RECORDINGS, load_extensions
from perception.number_tables import LFS, check_pointer
from perception.sources.bags import bag
from perception.sources.folders import (
    numbered_images,
    record3d,
    rtabmap_database,
    seven_scenes,
    stray_scanner,
    transforms_json,
    tum,
)
from perception.sources.folders.datasets import DATASETS
from perception.sources.folders.exports import EXPORTS
from perception.sources.folders.unread import hint_of
from perception.sources.listing import Format

#: Tried in this order when the format is not named, before those of extensions.
FORMATS: tuple[Format, ...] = (
    seven_scenes.FORMAT,
    *DATASETS,
    *EXPORTS,
    tum.FORMAT,
    numbered_images.TRAJECTORY_LOG,
    numbered_images.HOLOLENS,
    numbered_images.POSE_FILES,
    numbered_images.REPLICA,
    stray_scanner.FORMAT,
    record3d.FORMAT,
    rtabmap_database.FORMAT,
    transforms_json.TRANSFORMS,
    transforms_json.POLYCAM,
    bag.FORMAT,
    numbered_images.IMAGES,
)
_NAMED = 5  # recordings of a folder that a message names


def all_formats() -> Iterator[Format]:
    """The formats of `FORMATS`, then those of extensions, which are imported when reached."""
    yield from FORMATS
    yield from load_extensions(RECORDINGS, Format)


def format_of(path: Path, name: str = "auto") -> Format:
    """Format of a recording by its files, or by name; raises RecordingError for no recording."""
    if name != "auto" and name not in (names := [known.name for known in all_formats()]):
        raise RecordingError(
            f"unknown recording format {name!r}{did_you_mean(name, names)}; known are auto, "
            f"{_known_formats()}"
        )
    if not path.exists():
        raise RecordingError(f"recording {path} does not exist")
    if path.is_dir() and not any(path.iterdir()):
        raise RecordingError(f"recording {path} is empty; known formats are {_known_formats()}")
    if path.is_file():
        with path.open("rb") as file:
            check_pointer(file.read(len(LFS)), path)
    for candidate in all_formats():
        if name in ("auto", candidate.name):
            named = name == candidate.name and path.is_dir()
            if named or candidate.matches(path):
                return candidate
    hint = _nested(path) or hint_of(path)
    raise RecordingError(
        f"{path} is no recording of a known format"
        + (f"; {hint}" if hint else f"; known are {_known_formats()}")
    )


def _known_formats() -> str:
    return "; ".join(f"{known.name} ({known.looks_for})" for known in all_formats())


def _nested(folder: Path) -> str:
    """A hint where recordings lie in a folder."""
    inner = sorted(folder.iterdir()) if folder.is_dir() else []
    found = [p for p in inner if any(known.matches(p) for known in all_formats())]
    if len(found) > 1:
        names = ", ".join(p.name for p in found[:_NAMED]) + ", ..." * (len(found) > _NAMED)
        return f"it holds {len(found)} recordings, {names}: name one, such as {found[0]}"
    kind = "folder" if found and found[0].is_dir() else "file"
    return f"its {kind} {found[0].name} is one: open {found[0]}" if found else ""
