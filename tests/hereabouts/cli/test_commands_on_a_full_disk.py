"""Commands on the map of a full disk: reading works, and writing is refused in one plain line."""

import shutil
from pathlib import Path

import pytest

from hereabouts.cli import main
from tests.hereabouts.cli.test_damaged_files import empty_logs
from tests.hereabouts.cli.test_full_disk import disk, filled  # noqa: F401 (a fixture)


@pytest.fixture
def full(disk: Path, kitchen_map: Path) -> Path:  # noqa: F811
    """A map on a disk without space, whose writers have closed it."""
    path = shutil.copytree(kitchen_map, disk / "flat.map")
    empty_logs(path)
    (path / "looks.npz").unlink(missing_ok=True)
    filled(disk / "ballast", 0)
    return path


def test_a_map_on_a_full_disk_is_read(full: Path, tmp_path: Path) -> None:
    before = sorted(path.name for path in full.iterdir())
    for words in (
        ["ask", "objects"],
        ["find", "wallet"],
        ["plot", "-o", str(tmp_path / "map.svg")],
        ["export", "-o", str(tmp_path / "map.ply")],
        ["check"],
    ):
        assert main([words[0], str(full), *words[1:]]) == 0, words
    assert not (full / "looks.part").exists()
    new = {path.name for path in full.iterdir()} - set(before)
    assert all(name.startswith("history.sqlite-") for name in new)


def test_writing_to_a_full_disk_is_refused_in_one_line(full, fails):
    full_map = "error: no space left on the disk of map flat.map; free some and retry\n"
    assert fails("name", full, "object/1", "mug", "--by", "ann") == full_map
    assert fails("assert", full, "object/1", "label", "mug", "--by", "ann") == full_map
    for ending in ("ttl", "ply", "mcap"):
        to = full.parent / f"map.{ending}"
        assert fails("export", full, "-o", to).endswith(": No space left on device\n")
        assert not to.exists() or to.stat().st_size == 0
