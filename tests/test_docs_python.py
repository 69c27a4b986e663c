"""The examples of docs/how-to/python.md print what it shows."""

import contextlib
import io
import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "how-to" / "python.md").read_text(
    encoding="utf-8"
)
BLOCKS = re.findall(
    r"^```python\n(.*?)^```$(?:\n```output\n(.*?)^```$)?", PAGE, flags=re.MULTILINE | re.DOTALL
)


def test_the_page_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("HEREABOUTS_TOKEN", "HEREABOUTS_SERVER"):
        monkeypatch.setenv(name, "")  # the page sets it: to be as it was afterwards
    assert len(BLOCKS) >= 6
    names: dict[str, object] = {}
    for code, expected in BLOCKS:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "docs/how-to/python.md", "exec"), names)
        assert printed.getvalue() == expected, code
