"""The public module: its names are exact, and cost nothing until they are used."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import hereabouts

SOURCE = ast.parse(Path(hereabouts.__file__).read_text(encoding="utf-8"))


def test_each_public_name_is_also_known_to_type_checkers() -> None:
    (block,) = (
        n
        for n in SOURCE.body
        if isinstance(n, ast.If)
        and "else" not in ast.unparse(n.test)
        and isinstance(n.test, ast.Name)
    )
    imported = {
        a.asname or a.name: n.module
        for n in block.body
        if isinstance(n, ast.ImportFrom)
        for a in n.names
    }
    assert {*imported, "__version__"} == {*hereabouts.__all__}
    for name, module in imported.items():
        assert getattr(hereabouts, name).__module__ == module


def test_only_public_names_exist() -> None:
    assert dir(hereabouts) == hereabouts.__all__ == sorted(set(hereabouts.__all__))
    with pytest.raises(AttributeError, match="no attribute 'HistoryLog'"):
        _ = hereabouts.HistoryLog


def test_version_is_that_of_the_distribution() -> None:
    assert hereabouts.__version__ == version("hereabouts")


def test_the_import_loads_nothing_else() -> None:
    code = "import sys; old = {*sys.modules}; import hereabouts; print(*({*sys.modules} - old))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    packages = {name.partition(".")[0] for name in done.stdout.split()}
    assert packages <= {"hereabouts", "importlib", "_frozen_importlib", "warnings", "__future__"}
