"""Commands that answers, notes and errors print: each can be copied into a shell, and works."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from hereabouts.cli import main
from tests.planner.flat import flat_map

#: commands on a map that has a space in its name, with the word MAP for it
COMMANDS = (
    "find MAP giraffe",
    "find MAP kitchen",
    "find MAP",
    "status MAP object/99",
    "status MAP kitchen",
    "why MAP object/99",
    "why MAP --candidates cup",
    "log MAP",
    "log MAP 'cup 2'",
    "log MAP object/99",
    "diff MAP 1h",
    "ask MAP objcts",
    "ask MAP 'where is the cup?' --explain",
    'ask MAP "what is in the kitchen\'s fridge" --explain',
    "ask MAP 'what is in the kitchen' --explain",
    "ask MAP 'when did you last see the bed' --explain",
    "ask MAP 'is there a cup in the cellar'",
    "ask MAP 'what is on the bed' --explain",
    "ask MAP 'which rooms are there' --explain",
    "ask MAP objects-by-category -p category=kettle",
    "info MAP",
    "check MAP",
    "name MAP",
    "name MAP 'cup 2' dog",
    "name MAP --review sheet.html",
    "retract MAP 'cup 2' category --by ann",
    "export MAP",
)
_HINTS = re.compile(
    r"`(hereabouts [^`]+)`|\((hereabouts [^`()]+)\)"
    r"|(?<!example: )(?<![`(])\b(hereabouts [a-z]+ [^`\n]+?)"
    r"(?=$| shows| sets| lists|, hereabouts|;)"
)
_BLANK = re.compile(r"\b(?:[A-Z]{3,}|LANG)\b(?!\.)")  # a word that people fill in: THING, NAME


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flat_map(tmp_path_factory.mktemp("hints") / "my flat.map")


def run(capsys: pytest.CaptureFixture[str], words: list[str]) -> tuple[int, str]:
    """Exit code of a command, and all that it prints."""
    capsys.readouterr()
    try:
        code = main(words)
    except SystemExit as stopped:
        code = int(stopped.code or 0)
    printed = capsys.readouterr()
    return code, f"{printed.out}\n{printed.err}"


def hints(printed: str) -> list[str]:
    """The commands in a text, but for examples with other maps and those with a blank."""
    found = ["".join(groups).strip() for groups in _HINTS.findall(printed)]
    return [one for one in found if "kitchen.map" not in one and "home.map" not in one]


@pytest.mark.parametrize("command", COMMANDS)
def test_each_printed_command_works(
    flat: Path,
    tmp_path: Path,
    command: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    _, printed = run(capsys, [str(flat) if w == "MAP" else w for w in shlex.split(command)])
    for hint in hints(printed):
        assert " MAP" not in hint
        if _BLANK.search(hint.replace(str(flat), "")):
            continue
        code, told = run(capsys, shlex.split(hint)[1:])
        assert code == 0, f"{hint}\n{told}"


def test_the_commands_print_hints(flat: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = {
        hint
        for command in COMMANDS[:10]
        for hint in hints(
            run(capsys, [str(flat) if w == "MAP" else w for w in shlex.split(command)])[1]
        )
    }
    assert len(found) >= 5
