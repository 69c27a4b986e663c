"""Every relative link of the documentation leads to a file, and to a heading of it."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(p for glob in ("*.md", "docs/**/*.md", "lab/**/*.md") for p in ROOT.glob(glob))
_LINK = re.compile(r"\]\(([^)\s]+)\)")


def _anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).strip().replace(" ", "-") for text in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    broken = []
    for link in _LINK.findall(page.read_text(encoding="utf-8")):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (anchor and anchor not in _anchors(target)):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_have_titles_not_names_of_files(page: Path) -> None:
    if page.name != "CHANGELOG.md":
        assert re.findall(r"\[[^\]]*\.md\]\(", page.read_text(encoding="utf-8")) == []


def test_files_of_the_documentation_that_code_names_exist() -> None:
    named = {
        match
        for folder in (
            *("hereabouts", "kg", "perception", "mapping", "planner", "lab", "benchmarks"),
            "tests",
        )
        for source in (ROOT / folder).rglob("*.py")
        for match in re.findall(r"(?:docs|lab)/[\w./-]+\.md", source.read_text(encoding="utf-8"))
    }
    assert sorted(name for name in named if not (ROOT / name).exists()) == []


def test_pictures_are_small() -> None:
    pictures = sorted((ROOT / "docs" / "pictures").iterdir())
    assert pictures
    most = {".png": 150_000, ".webp": 1_000_000}  # bytes; a .webp moves
    assert [p.name for p in pictures if p.stat().st_size > most[p.suffix]] == []


def test_every_picture_is_made_by_the_command_or_said_to_be_made_otherwise() -> None:
    script = (ROOT / "docs" / "make_pictures.py").read_text(encoding="utf-8")
    pictures = [picture.stem for picture in (ROOT / "docs" / "pictures").iterdir()]
    assert [name for name in pictures if f'"{name}": ' not in script] == ["rviz"]


def test_the_index_links_to_every_page() -> None:
    docs = ROOT / "docs"
    linked = set(_LINK.findall((docs / "index.md").read_text(encoding="utf-8")))
    pages = {str(page.relative_to(docs)) for page in docs.rglob("*.md")} - {"index.md"}
    assert pages - linked == set()
