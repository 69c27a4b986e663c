"""The page on the architecture is what docs/make_architecture.py draws of contracts and code."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SCRIPT = runpy.run_path(str(ROOT / "docs" / "make_architecture.py"))


def test_the_page_is_up_to_date() -> None:
    page = SCRIPT["PAGE"].read_text(encoding="utf-8")
    assert page == SCRIPT["with_drawing"](page), "run python docs/make_architecture.py"


@pytest.mark.parametrize("package", SCRIPT["PACKAGES"])
def test_every_room_of_a_package_is_drawn(package: str) -> None:
    drawn = {room for row in SCRIPT["layers"](package) for room in row}
    folder = ROOT / package
    rooms = {path.stem for path in folder.glob("*.py")}
    rooms |= {path.parent.name for path in folder.glob("*/__init__.py")}
    assert drawn == rooms - {"__init__"}


@pytest.mark.parametrize("title", SCRIPT["WALKS"])
def test_a_walk_is_short_and_every_step_says_what_happens(title: str) -> None:
    modules = SCRIPT["WALKS"][title]
    assert 10 <= len(modules) <= 25
    assert len(set(modules)) == len(modules)
    assert all(map(SCRIPT["summary"], modules))
