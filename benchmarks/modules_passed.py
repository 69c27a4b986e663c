"""Count the modules and rooms that run in four walks: a frame, an HTTP query, a find, an ask.

    python -m benchmarks.modules_passed RECORDING [--list]

RECORDING is any recording that `hereabouts map` reads. A module is counted when one of its
functions is called during the walk, in this process: not when it is only imported, and not in the
process that evaluates an HTTP query. Modules are listed in the order of their first calls. A room
is a package or module directly below one of our packages. A return is a step
in this order from one room into another one that an earlier module was in. To count another
checkout, run this file with its folder as PYTHONPATH.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import inspect
import io
import sys
import tempfile
import threading
import urllib.parse
import urllib.request
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from types import FrameType
from typing import Any

PACKAGES = ("hereabouts.", "kg.", "perception.", "mapping.", "planner.")
FRAMES = range(20, 40)  # first and last frame of the window that is counted
QUERY = "SELECT ?object { ?object a here:Chair }"


class ModuleCounter:
    """A profile function that collects the modules whose functions are called while it is on.

    `watch(module, function)` sees each call and may turn it on and off.
    """

    def __init__(self) -> None:
        self.on = False
        self.modules: dict[str, None] = {}  # in the order of the first call
        self.watch: Callable[[str, str], None] = lambda module, function: None

    def __call__(self, frame: FrameType, event: str, argument: object) -> None:
        """The profile function that `sys.setprofile` calls."""
        module = frame.f_globals.get("__name__", "")
        if event != "call" or not module.startswith(PACKAGES):
            return
        if not frame.f_code.co_flags & inspect.CO_OPTIMIZED:
            return  # the body of a module or class: an import
        self.watch(module, frame.f_code.co_qualname)
        if self.on:
            self.modules.setdefault(module)

    def rooms_and_returns(self) -> tuple[int, int]:
        """Numbers of the rooms, and of the steps into a room that the walk had left."""
        steps = [room for room, _ in groupby(".".join(m.split(".")[:2]) for m in self.modules)]
        return len(set(steps)), len(steps) - len(set(steps))

    def start(self) -> None:
        """Count in this thread, and in threads started from now on."""
        threading.setprofile(self)
        sys.setprofile(self)

    def stop(self) -> None:
        """Count no more."""
        sys.setprofile(None)
        threading.setprofile(None)


def frame_walk(recording: str, into: Path) -> ModuleCounter:
    """Map the recording; count from the mapping of frame 20 to that of frame 40."""
    counter, made = ModuleCounter(), 0

    def watch(module: str, function: str) -> None:
        nonlocal made
        if module == "mapping.mapper" and function == "Mapper.add":
            made += 1
            counter.on = made in FRAMES

    counter.watch = watch
    _command(counter, ["map", recording, "--into", str(into)])
    return counter


def command_walk(name: str, *words: str) -> ModuleCounter:
    """Run a command; count from its `run` on, behind the parsing of arguments."""
    counter = ModuleCounter()

    def watch(module: str, function: str) -> None:
        if module.endswith(f".{name}") and function == "run":
            counter.on = True

    counter.watch = watch
    _command(counter, [name, *words])
    return counter


def query_walk(path: Path) -> ModuleCounter:
    """Serve the map and ask it twice over HTTP; count the second query."""
    server_module = _first("kg.serving.server", "kg.server")
    counter = ModuleCounter()
    counter.start()
    try:
        with (
            _first("kg.serving.opening", "kg.opening").open_map(path) as served,
            server_module.MapServer(served, server_module.Settings(port=0)) as server,
        ):
            _ask(server.url)  # starts a worker process
            counter.on = True
            _ask(server.url)
            counter.on = False
    finally:
        counter.stop()
    return counter


def _ask(url: str) -> None:
    query = urllib.parse.urlencode({"query": QUERY})
    with urllib.request.urlopen(f"{url.rstrip('/')}/sparql?{query}", timeout=60) as answer:
        answer.read()


def _command(counter: ModuleCounter, words: list[str]) -> None:
    main = _first("hereabouts.cli", "planner.commands").main
    counter.start()
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            code = main(words)
    finally:
        counter.stop()
    if code:
        raise SystemExit(f"hereabouts {' '.join(words)}: exit code {code}")


def _first(*names: str) -> Any:
    """The first of these modules that exists: packages were renamed."""
    for name in names:
        with contextlib.suppress(ModuleNotFoundError):
            return importlib.import_module(name)
    raise SystemExit(f"no module {' or '.join(names)}")


def main() -> None:
    """Walk, and print a line for each walk."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording")
    parser.add_argument("--list", action="store_true", help="name the modules, in order")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.map"
        walks = {"a frame": frame_walk(arguments.recording, path)}
        walks["an HTTP query"] = query_walk(path)
        walks["a find"] = command_walk("find", str(path), "banana", "--from", "0,0")
        walks["an ask"] = command_walk("ask", str(path), "objects")
    for name, counter in walks.items():
        rooms, returns = counter.rooms_and_returns()
        print(f"{name}: {len(counter.modules)} modules, {rooms} rooms, {returns} returns")  # noqa: T201
        if arguments.list:
            print("    " + " ".join(counter.modules))  # noqa: T201


if __name__ == "__main__":
    main()
