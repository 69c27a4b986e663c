"""Commands, modules and files that the documentation names exist."""

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(p for glob in ("*.md", "docs/**/*.md", "lab/**/*.md") for p in ROOT.glob(glob))
_OF_OTHER_VERSIONS = ("CHANGELOG.md", "upgrading.md")  # they name what there was
_PACKAGES = ("hereabouts", "kg", "perception", "mapping", "planner", "lab")
_MODULE = r"(?:hereabouts\.(?:cli|demo|agents|display)|kg|perception|mapping|planner|lab)(?:\.\w+)+"
_FOLDERS = "hereabouts|kg|perception|mapping|planner|lab|benchmarks|tests|queries|ontologies"


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_commands_of_a_page_parse(page: Path) -> None:
    from hereabouts.cli import build_parser

    parser = build_parser()
    lines = re.findall(
        r"^ {4,}(?:\w+=\S+ )*(hereabouts .*)$", page.read_text("utf-8"), re.MULTILINE
    )
    for line in lines:
        if _is_pattern(line):
            continue
        words = shlex.split(line, comments=True)
        try:
            arguments = parser.parse_args(words[1:])
        except SystemExit:
            pytest.fail(f"does not parse: {line}")
        assert arguments.run


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in _OF_OTHER_VERSIONS], ids=_name)
def test_files_and_modules_of_a_page_exist(page: Path) -> None:
    code = re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8"))
    paths = [t for t in code if re.fullmatch(rf"(?:{_FOLDERS})/[\w./-]*[\w/]", t)]
    missing = [p for p in paths if "NAME" not in p and not (ROOT / p).exists()]
    modules = [t for t in code if re.fullmatch(_MODULE, t)]
    missing += [name for name in modules if not _is_importable(name)]
    assert missing == []


def _is_pattern(line: str) -> bool:
    """Whether a line shows several commands at once, or goes on in the next line."""
    return line.endswith("\\") or re.search(r"[\[|]|\.\.\.|\bMAP\b", line) is not None


def _is_importable(name: str) -> bool:
    """Whether `name` is a module, or an attribute of one."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        value: object = module
        for attribute in parts[end:]:
            if not hasattr(value, attribute):
                return False
            value = getattr(value, attribute)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_python_examples_import_public_names_or_mark_inner_ones(page: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    imported = [
        f"{node.module}.{alias.name}"
        for block in blocks
        if page.name != "api.md"  # signatures, no programs
        for node in ast.walk(ast.parse(block))
        if isinstance(node, ast.ImportFrom) and node.module is not None
        for alias in node.names
    ]
    ours = [name for name in imported if name.split(".")[0] in ("hereabouts", *_PACKAGES)]
    assert [name for name in ours if not _is_importable(name)] == []
    marked = {
        line.split()[1]
        for block in blocks
        for line in block.splitlines()
        if line.startswith("from ") and line.endswith("# inner: may change")
    }
    inner = [n for n in ours if n.rpartition(".")[0] not in {"hereabouts", *marked}]
    assert inner == [] or page.parent.name == "research"  # laboratory notes
