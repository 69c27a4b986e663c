"""What the README promises is what happens."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```bash\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def test_there_are_two_command_blocks() -> None:
    install, tests = BLOCKS
    assert "pip install ." in install
    assert "pytest" in tests


def test_the_first_block_runs_the_demo_that_ci_runs_from_it() -> None:
    commands = [line for line in BLOCKS[0].splitlines() if line.startswith("hereabouts ")]
    ci = (ROOT / ".ci" / "run").read_text()
    assert commands == ["hereabouts demo"] and "block 1" in ci and "test -s map.png" in ci


def test_indented_examples_are_commands_that_parse() -> None:
    from hereabouts.cli import build_parser

    examples = re.findall(r"^    (hereabouts .*)$", README, flags=re.MULTILINE)
    assert len(examples) >= 5
    for example in examples:
        assert build_parser().parse_args(shlex.split(example)[1:]).run


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#:]+)\)", README))
def test_links_of_the_readme_exist(link: str) -> None:
    assert (ROOT / link).exists()
