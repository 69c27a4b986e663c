"""Damaged files beside a map: named by `check`, and told by the commands that need them."""

import logging
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from hereabouts.cli import main
from mapping.key_views.view_store import stored_views

FILES = ("tracks.sqlite", "views.sqlite", "looks.npz", "detections.json", "surface.sqlite")


@pytest.fixture(scope="module")
def with_looks(kitchen_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of the kitchen with looks of its objects."""
    folder = tmp_path_factory.mktemp("looks")
    path = shutil.copytree(kitchen_map, folder / "a.map")
    empty_logs(path)
    before = sorted(path.iterdir())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        assert main(["find", str(path), "wallet"]) == 0
    assert sorted(path.iterdir()) == before  # a reader computes them, and keeps them elsewhere
    shutil.copyfile(folder / "hereabouts" / "looks.npz", path / "looks.npz")
    assert all((path / name).is_file() for name in FILES)
    return path


@pytest.fixture
def mapped(with_looks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it that a test may damage."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return shutil.copytree(with_looks, tmp_path / "a.map")


def empty_logs(folder: Path) -> None:
    """Empty the logs beside SQLite files, as their writers do when they close them."""
    for file in folder.glob("*.sqlite"):
        with closing(sqlite3.connect(file)) as opened:
            opened.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def kept(folder: Path) -> dict[str, bytes]:
    """The files, and those that SQLite makes beside them."""
    paths = [path for path in folder.iterdir() if path.name.startswith(FILES[:4])]
    return {path.name: path.read_bytes() for path in paths}


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def text(path: Path) -> None:
    path.write_bytes(b"no such file" * 100)


def empty(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("damage", [cut, text, empty])
def test_check_names_each_file_that_cannot_be_read(mapped, damage, capsys):
    before = kept(mapped)
    assert main(["check", str(mapped)]) == 0
    assert kept(mapped) == before
    for name in FILES:
        damage(mapped / name)
    capsys.readouterr()
    assert main(["check", str(mapped), "--json"]) == 1
    out, err = capsys.readouterr()
    assert "5 findings" in err
    for name in FILES:
        assert f'"focus": "{mapped / name}"' in out
    assert out.count("Traceback") == 0


@pytest.mark.parametrize(
    ("name", "statement"),
    [
        ("tracks.sqlite", "UPDATE tracks SET state = '[]'"),
        ("tracks.sqlite", "PRAGMA user_version = 99"),
        ("views.sqlite", "UPDATE views SET data = x'00'"),
        ("views.sqlite", "DROP TABLE views"),
    ],
)
def test_check_reads_what_is_inside(mapped, name, statement, capsys):
    with sqlite3.connect(mapped / name) as file:
        file.execute(statement)
    file.close()
    capsys.readouterr()
    assert main(["check", str(mapped), "--json"]) == 1
    out, err = capsys.readouterr()
    assert f'"focus": "{mapped / name}"' in out and "1 finding\n" in err


def test_commands_that_need_a_damaged_file_say_so_in_one_line_and_go_on(
    mapped: Path, kitchen: Path, caplog: pytest.LogCaptureFixture, capsys
) -> None:
    caplog.set_level(logging.WARNING)
    for name in ("tracks.sqlite", "views.sqlite", "looks.npz", "detections.json"):
        text(mapped / name)

    def said(command: str, *words: object) -> list[str]:
        caplog.clear()
        capsys.readouterr()
        assert main([command, str(words[0]), *map(str, words[1:])]) == 0
        lines = [record.getMessage() for record in caplog.records]
        lines += capsys.readouterr().err.split("\n")
        return [line for line in lines if line.startswith("cannot read ")]

    (line,) = said("find", mapped, "wallet")
    assert f"{mapped / 'looks.npz'} (it is damaged inside): looks are computed again" in line
    (mapped / "looks.npz").unlink()
    assert said("find", mapped, "wallet") == []
    (mapped / "views.sqlite").write_bytes(b"")
    assert stored_views(mapped, 1 << 40) == []
    again = ("map", kitchen, "--no-check", "--limit", 3, "--into", mapped, "--again")
    tracks, views = sorted(said(*again))
    assert f"{mapped / 'tracks.sqlite'} (file is not a database): mapping goes on" in tracks
    assert f"{mapped / 'views.sqlite'} (it is empty): recordings are not recognised" in views
    assert any("detections.json" in record.getMessage() for record in caplog.records)
    assert said("check", mapped) == []


def test_a_report_that_cannot_be_read_is_told_where_it_would_be_used(mapped, capsys):
    text(mapped / "detections.json")
    capsys.readouterr()
    assert main(["status", str(mapped), "giraffe"]) == 0
    assert f"{mapped / 'detections.json'} is no detection report" in capsys.readouterr().err
