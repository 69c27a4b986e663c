"""What the README promises is what happens."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from tests.waiting import HEREABOUTS

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```bash\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def run(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*HEREABOUTS, *words], cwd=folder, env=_environment(), capture_output=True, text=True
    )


def _environment() -> dict[str, str]:
    import os

    return {**os.environ, "MPLBACKEND": "Agg"}


def test_there_are_two_command_blocks() -> None:
    install, tests = BLOCKS
    assert "pip install ." in install
    assert "pytest" in tests


def test_first_block_leaves_the_map_its_export_and_its_picture(tmp_path: Path) -> None:
    commands = [line for line in BLOCKS[0].splitlines() if line.startswith("hereabouts ")]
    assert commands
    for command in commands:
        done = run(shlex.split(command)[1:], tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "demo.map").is_dir()
    assert (tmp_path / "map.ttl").stat().st_size > 1000
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_indented_examples_are_commands_that_parse() -> None:
    from hereabouts.cli import build_parser

    examples = re.findall(r"^    (hereabouts .*)$", README, flags=re.MULTILINE)
    assert len(examples) >= 5
    for example in examples:
        assert build_parser().parse_args(shlex.split(example)[1:]).run


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#:]+)\)", README))
def test_links_of_the_readme_exist(link: str) -> None:
    assert (ROOT / link).exists()
