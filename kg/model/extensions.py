"""Extensions of other distributions, by entry points: formats, detectors, exporters, robots ...

A distribution names them in its pyproject.toml:

    [project.entry-points."hereabouts.recordings"]
    npz = "my_robot.formats:NPZ"
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final, Literal, TypeVar

from kg.model.errors import ExtensionError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Group = Literal[
    "hereabouts.recordings",
    "hereabouts.detectors",
    "hereabouts.exporters",
    "hereabouts.connections",
    "hereabouts.robots",
]

RECORDINGS: Final[Group] = "hereabouts.recordings"
DETECTORS: Final[Group] = "hereabouts.detectors"
EXPORTERS: Final[Group] = "hereabouts.exporters"
CONNECTIONS: Final[Group] = "hereabouts.connections"
ROBOTS: Final[Group] = "hereabouts.robots"

T = TypeVar("T")


@functools.cache
def extensions(group: Group) -> Mapping[str, EntryPoint]:
    """The entry points of a group by name; their modules are not imported yet."""
    from importlib.metadata import entry_points  # takes 20 ms; most commands do not need it

    return {point.name: point for point in entry_points(group=group)}


def load_extension(group: Group, name: str, kind: type[T]) -> T:
    """Import the extension `name`.

    Raises:
        ExtensionError: the import fails, or the object is not a `kind`.
    """
    point = extensions(group)[name]
    try:
        found: object = point.load()
    except Exception as error:
        raise ExtensionError(f"{_described(point)} cannot be imported: {error!r}") from error
    if not isinstance(found, kind):
        raise ExtensionError(
            f"{_described(point)} must be a {kind.__name__}, got {type(found).__name__}"
        )
    return found


def load_extensions(group: Group, kind: type[T]) -> Iterator[T]:
    """All extensions of a group, by name; raises ExtensionError as `load_extension` does."""
    for name in sorted(extensions(group)):
        yield load_extension(group, name, kind)


def _described(point: EntryPoint) -> str:
    owner = f" of {point.dist.name}" if point.dist is not None else ""
    return f"the extension {point.name!r} in {point.group}{owner} ({point.value})"
