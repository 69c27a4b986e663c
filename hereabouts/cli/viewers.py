"""Viewers that a command feeds while it runs: `--mcap` and `--rerun`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note

if TYPE_CHECKING:
    from hereabouts.display.viewers.viewer import Viewer


_VIEWERS = """
--mcap OUT   record frames, boxes, map, robot and plan in a new MCAP file for Foxglove
--rerun OUT  record the same in a new .rrd file for Rerun
"""


def add_viewers(parser: argparse.ArgumentParser) -> None:
    """The options that `open_viewers` reads."""
    declare(parser, _VIEWERS)


@contextmanager
def open_viewers(arguments: argparse.Namespace, title: str) -> Iterator[Viewer | None]:
    """The viewers of the options as one viewer; None without any.

    Raises PictureError if a package is missing, or if a file exists or cannot be written. A viewer
    that fails later raises at the end of the context.
    """
    files = [(arguments.mcap, _mcap), (arguments.rerun, _rerun)]
    opened = [make(Path(path), title) for path, make in files if path is not None]
    if not opened:
        yield None
        return
    from hereabouts.display.viewers.viewer import ViewerGroup

    with closing(ViewerGroup(opened)) as viewers:
        yield viewers
    for path, _ in files:
        if path is not None and Path(path).exists():
            note(f"wrote {path}")


def _mcap(path: Path, title: str) -> Viewer:
    from hereabouts.display.viewers.viewer import require

    require("foxglove", "foxglove")
    from hereabouts.display.viewers.foxglove_viewer import McapFile

    return McapFile(path)


def _rerun(path: Path, title: str) -> Viewer:
    from hereabouts.display.viewers.viewer import require

    require("rerun", "rerun")
    from hereabouts.display.viewers.rerun_viewer import RerunFile

    return RerunFile(title, path)
