"""The public module: its names are exact, and cost nothing until they are used."""

import ast
import doctest
import importlib
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import hereabouts
from tests.planner.flat import fill

ROOT = Path(__file__).resolve().parent.parent
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


PACKAGES = ("hereabouts", "kg", "mapping", "perception", "planner")
WITH_EXAMPLES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_of_docstrings_are_true(name: str) -> None:
    done = doctest.testmod(importlib.import_module(name))
    assert done.attempted and not done.failed


def test_a_printed_table_and_plan_are_read_at_a_glance() -> None:
    with hereabouts.in_memory_map() as semantic_map:
        fill(semantic_map)
        told = str(semantic_map.query("objects")).splitlines()
        assert told[0].split()[:3] == ["object", "label", "category"]
        assert len(told) == 4 and "object/" in told[1] and "https://" not in told[1]
        search = hereabouts.build_search(semantic_map, ["cup"])
        first, *steps = str(hereabouts.plan_views(search, (1.0, 1.0))).splitlines()
        assert re.match(r"cup: .*[Tt]h(is look finds|ese looks find) it with ", first)
        assert steps[0].startswith("1. From (")
