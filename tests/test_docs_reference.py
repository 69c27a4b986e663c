"""The generated reference pages are what docs/generate.py makes of the code."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_reference_pages_are_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, "docs/generate.py", "--check"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, f"run python docs/generate.py:\n{done.stdout}{done.stderr}"


def test_every_command_has_a_section() -> None:
    from hereabouts.cli import COMMANDS, LAB_COMMANDS

    page = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    names = {"map_recording": "map", "import_maps": "import", "assert_": "assert"}
    missing = [
        n for n in (*COMMANDS, *LAB_COMMANDS) if f"\n## hereabouts {names.get(n, n)}" not in page
    ]
    assert missing == []
