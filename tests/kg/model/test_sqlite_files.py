import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from kg.model.sqlite_files import open_sqlite

TABLES = ("CREATE TABLE a (x)", "CREATE TABLE b (y)")


def test_a_database_has_its_name_once_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with pytest.raises(sqlite3.Error):  # as a kill, it ends between the tables
        open_sqlite(path, (TABLES[0], "CREATE TABLE"), 1, 10**6)
    assert not path.exists()
    for _ in range(2):
        with closing(open_sqlite(path, TABLES, 1, 10**6)) as file, file:
            file.execute("INSERT INTO b VALUES (1)")
    with closing(open_sqlite(path, TABLES, 1, 10**6, read_only=True)) as file:
        assert file.execute("SELECT count(*) FROM b").fetchone() == (2,)
    assert [one.name for one in tmp_path.iterdir()] == ["a.sqlite"]


def test_one_without_tables_gets_them_and_one_with_others_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with closing(sqlite3.connect(path)) as file:
        file.execute("PRAGMA journal_mode = WAL")  # an earlier release was killed here
    open_sqlite(path, TABLES, 1, 10**6).close()
    for tables, version in ((TABLES, 2), (TABLES[:1], 1)):
        with pytest.raises(ValueError, match="another version"):
            open_sqlite(path, tables, version, 10**6)
