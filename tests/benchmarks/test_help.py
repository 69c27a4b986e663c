"""Every benchmark can be started, and tells how."""

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: run by other benchmarks alone; the last needs nothing of ours and reads its arguments itself
PARTS = ("attack/crowding.py", "kills/recorded_work.py", "questions/scoring.py")
PROGRAMS = sorted(
    path.relative_to(ROOT)
    for folder in ("benchmarks", "lab/ordering", "lab/thesis")
    for path in (ROOT / folder).rglob("*.py")
    if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
    and not str(path).endswith(PARTS)
)


@pytest.mark.parametrize("program", PROGRAMS, ids=str)
def test_help_is_told_before_anything_else(program, monkeypatch, capsys):
    module = ".".join(program.with_suffix("").parts)
    monkeypatch.setattr(sys, "argv", [str(program), "--help"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(module).main()
    assert ended.value.code == 0
    name = module.removesuffix(".__main__")
    assert capsys.readouterr().out.startswith(f"usage: python -m {name} [-h]")
