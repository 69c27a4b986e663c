"""Systems without the calls of Linux: every module is imported, and a house is mapped and asked."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from kg.model import platforms
from kg.model.errors import MapBusyError
from kg.store.folder import locked

ROOT = Path(__file__).resolve().parent.parent
ELSEWHERE = """
import asyncio, concurrent.futures, multiprocessing.connection, os, select, shutil, signal
import socket, sqlite3, subprocess, sys, tempfile, threading
import uvicorn, starlette.applications, onnxruntime, cv2
import mcp.server, rerun  # what a library imports is its own affair
for name in ("fcntl", "resource", "termios", "pwd", "grp"):
    sys.modules[name] = None  # their import fails from now on
space = shutil.disk_usage(".")  # of another call on Windows
shutil.disk_usage = lambda path: space
for module, names in {
    os: "O_NOFOLLOW O_NONBLOCK O_CLOEXEC O_DIRECTORY O_PATH geteuid getuid fork link mkfifo "
    "set_blocking setpriority register_at_fork statvfs sysconf",
    select: "poll",
    signal: "SIGALRM SIGKILL SIGXCPU SIGHUP SIGUSR1 setitimer getitimer ITIMER_REAL",
    socket: "AF_UNIX SO_PEERCRED SO_REUSEPORT",
}.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
"""
IMPORTS = """
import importlib, pkgutil
for package in ("hereabouts", "kg", "mapping", "perception", "planner"):
    for found in pkgutil.walk_packages([package], package + "."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
"""
MAPS = """
import hereabouts
from lab.houses.random_house import random_house
from planner.simulation.house_robot import SimulatedTour
from planner.simulation.camera import SimulatedCamera
from planner.simulation.sensors import SimulatedDetector
camera = SimulatedCamera(random_house(77), seed=77)
detector = SimulatedDetector(camera)
tour = SimulatedTour(camera)
with hereabouts.create_map(sys.argv[1]) as semantic_map:
    mapper = hereabouts.Mapper(semantic_map)
    for number in range(30):
        frame = next(tour.frames(number))
        mapper.add(frame, detector.detect(frame))
    mapper.flush()
from hereabouts.cli import main
for words in (["ask", sys.argv[1], "objects"], ["status", sys.argv[1], "chair"],
              ["find", sys.argv[1], "chair"], ["export", sys.argv[1], "-o", sys.argv[1] + ".ttl"],
              ["name", sys.argv[1], "object/1", "my", "chair", "--by", "ann"]):
    assert main(words) == 0, words
from pathlib import Path
from kg.store.folder import has_room  # before a store is opened again after a failed write
assert has_room(Path(sys.argv[1]))
"""


def elsewhere(program: str, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE + program, *words],
        cwd=ROOT,
        env=os.environ | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_every_module_is_imported() -> None:
    elsewhere(IMPORTS)


def test_a_house_is_mapped_asked_edited_and_exported(tmp_path: Path) -> None:
    told = elsewhere(MAPS, str(tmp_path / "a.map"))
    assert "chair" in told and (tmp_path / "a.map.ttl").stat().st_size > 1000


def test_the_lock_of_windows_keeps_a_second_writer_out(tmp_path, monkeypatch):
    files: set[int] = set()

    def locking(descriptor: int, how: int, size: int) -> None:
        file = os.fstat(descriptor).st_ino
        if file in files:
            raise PermissionError(13, "Permission denied")
        files.add(file)

    monkeypatch.setattr(platforms, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    os.close(locked(tmp_path / "lock", tmp_path, shared=False))
    for shared, complaint in ((False, "is already open"), (True, "is being written")):
        with pytest.raises(MapBusyError, match=complaint):
            locked(tmp_path / "lock", tmp_path, shared=shared)
