"""A small real recording and a small map, for the command line's tests."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hereabouts.cli import main
from lab.recordings.simulated_recording import SimulationOptions, simulate_house
from tests.conftest import Captured, failed, printed


def _copy_kitchen(source: Path, folder: Path) -> Path:
    folder.mkdir()
    for number in range(0, 256, 32):
        for path in source.glob(f"frame-{number:06d}.*"):
            shutil.copy(path, folder)
    for name in ("color-intrinsics.txt", "camera-intrinsics.txt", "gravity-direction.txt"):
        shutil.copy(source / name, folder)
    return folder


def simulated(folder: Path, seed: int, sessions: int = 1, noise: float = 0.0) -> Path:
    """A simulated house in few and small frames; truth and detections are of thrice as many."""
    options = SimulationOptions(size=(80, 60), odometry=noise, stride=2)
    simulate_house(folder, seed, sessions, options)
    for listed in folder.rglob("rgb.txt"):
        listed.write_text("\n".join(listed.read_text().splitlines()[::3]) + "\n")
    return folder


@pytest.fixture
def kitchen(shared: Callable[[str], Path], tmp_path: Path) -> Path:
    """Eight distinct views of the real kitchen, as a recording that a test may damage."""
    return _copy_kitchen(shared("data/rgbd/redkitchen"), tmp_path / "kitchen")


@pytest.fixture(scope="session")
def kitchen_map(shared: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of these frames; to be copied by who changes it."""
    folder = tmp_path_factory.mktemp("mapped")
    kitchen = _copy_kitchen(shared("data/rgbd/redkitchen"), folder / "kitchen")
    assert main(["map", str(kitchen), "--into", str(folder / "kitchen.map")]) == 0
    return folder / "kitchen.map"


@pytest.fixture(scope="session")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two recordings of one simulated house, between which small things were moved."""
    folder = simulated(tmp_path_factory.mktemp("sessions") / "house", 2, sessions=2)
    return folder / "session-1", folder / "session-2"


@pytest.fixture(scope="session")
def imported_lab(shared: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lab") / "lab.map"
    files = [
        "--objects",
        str(shared("reference/saved_objects_lab.json")),
        "--places",
        str(shared("reference/saved_places_lab.json")),
    ]
    assert main(["thesis", "import", *files, "--into", str(path)]) == 0
    return path


@pytest.fixture
def lab(imported_lab: Path, tmp_path: Path) -> Path:
    """The thesis author's saved laboratory as a map that a test may change."""
    return shutil.copytree(imported_lab, tmp_path / "lab.map")


@pytest.fixture
def fails(capsys: Captured) -> Callable[..., str]:
    """Callable: the line of a command that must fail with exit code 1 and one line."""
    return lambda *words: failed(main, words, capsys)


@pytest.fixture
def prints(capsys: Captured) -> Callable[..., str]:
    """Callable: the standard output of a command that must succeed."""
    return lambda *words: printed(main, words, capsys)
