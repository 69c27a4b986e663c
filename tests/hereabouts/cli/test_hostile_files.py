"""Files of strangers: each command that reads one ends in one line, and leaves no traceback."""

import pytest

from hereabouts.cli import main
from tests.hereabouts.cli.hostile_files import HOSTILE


@pytest.mark.parametrize("name", HOSTILE)
def test_a_file_of_a_stranger_is_refused_in_one_line(name, tmp_path, capsys):
    words = HOSTILE[name](tmp_path)
    assert main(words) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "new.map").exists()
