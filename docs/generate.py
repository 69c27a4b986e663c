"""Generate the reference pages under docs/reference from the code, the queries and the ontologies.

    python docs/generate.py            write the pages
    python docs/generate.py --check    exit code 1 where a page differs from what would be written

commands.md comes from argparse, queries.md from the headers of the query files, vocabulary.md from
the ontologies, api.md from the docstrings of the public names. The page on the architecture is
written too, by docs/make_architecture.py.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
import typing
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Final

import make_architecture
from vocabulary_page import vocabulary_page

import hereabouts

ROOT: Final = Path(__file__).resolve().parent.parent
REFERENCE: Final = ROOT / "docs" / "reference"

#: The names of the public module, by section of the page.
PUBLIC: Final = {
    "Maps": (
        *("create_map", "open_map", "open_or_create_map", "in_memory_map", "watch_map", "merged"),
        *("SemanticMap", "Table"),
    ),
    "Records": ("MapUpdate", "ObjectRecord", "PlaceRecord", "RoomEdit"),
    "Frames and recordings": (
        *("Frame", "Detections", "open_recording", "load_detector", "RecordingOptions"),
    ),
    "Mapping": ("Mapper", "MappingOptions", "Sighting", "map_recording"),
    "Searches and questions": (
        "find",
        "FindAnswer",
        "build_search",
        "plan_views",
        "ask",
        "PlainAnswer",
    ),
    "Extensions": (
        *("RecordingFormat", "RecordingListing", "FrameEntry", "Intrinsics", "Exporter"),
    ),
    "Serving": ("MapServer", "ServerSettings", "BearerTokens"),
    "Errors": ("HereaboutsError", "MapNotFoundError", "RecordingError"),
}
#: Modules of the classes that a map is composed of; their members are described with it.
_PARTS: Final = (
    *("kg.maps.map_parts", "kg.maps.subscriptions"),
    *("kg.maps.facts.assertion_service", "kg.maps.facts.robot"),
)
SHARED: Final = 2  # commands that have an option, from which on it is described once for all
_MADE: Final = "<!-- made by python docs/generate.py; edit the source, not this page -->\n"


def main() -> int:
    """Write the pages, or with `--check` compare them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    check = parser.parse_args().check
    stale = [name for name, make in PAGES.items() if _settle(REFERENCE / name, make(), check)]
    for name in stale:
        print("differs:" if check else "wrote", f"docs/reference/{name}")  # noqa: T201
    if make_architecture.settle(check):
        stale.append("architecture.md")
        print("differs:" if check else "wrote", "docs/explanation/architecture.md")  # noqa: T201
    return 1 if check and stale else 0


def _settle(page: Path, text: str, check: bool) -> bool:
    """Write `text` to `page` unless only checking; true where they differed."""
    differs = not page.exists() or page.read_text(encoding="utf-8") != text
    if differs and not check:
        page.write_text(text, encoding="utf-8")
    return differs


def commands() -> str:
    """The commands of `hereabouts`, their arguments and options."""
    from hereabouts.cli import build_parser

    leaves = [
        (words, parser, [_argument(parser, a) for a in parser._actions if a.dest != "help"])
        for words, parser in _leaves("hereabouts", build_parser())
    ]
    counts = Counter(row for _, _, rows in leaves for row in rows)
    shared = {
        row
        for row, count in counts.items()
        if count >= SHARED and row.startswith(("| `--", "| `MAP`"))
    }
    parts = [
        f"# Commands\n\n{_MADE}\nEach command prints its answer on stdout and everything else on "
        "stderr. Exit code 0: done; 1: an error, in one line; 2: wrong usage; `search` has more "
        "([Map live from ROS, and search with a robot](../how-to/ros.md)). The map may stand last, "
        "too. Commands that change nothing take the only map of the folder where none is given.\n",
        "## Options of several commands\n",
        *("| argument | |\n|---|---|", *(row for row in counts if row in shared), ""),
    ]
    parts += [_command(words, parser, rows, shared) for words, parser, rows in leaves]
    return "\n".join(parts)


def _leaves(
    words: str, parser: argparse.ArgumentParser
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Every command that takes no further command, in the order of `--help`."""
    groups = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not groups:
        yield words, parser
    for group in groups:
        for name, below in group.choices.items():
            yield from _leaves(f"{words} {name}", below)


def _command(
    words: str, parser: argparse.ArgumentParser, rows: Sequence[str], shared: Collection[str]
) -> str:
    """A section: text, example, arguments of its own, and the names of those that are shared."""
    lines = [f"## {words}", "", _line(parser.description or ""), ""]
    if parser.epilog:
        lines += ["    " + _line(parser.epilog).removeprefix("example: "), ""]
    own = [row for row in rows if row not in shared]
    if own:
        lines += ["| argument | |", "|---|---|", *own, ""]
    if names := [f"`{row.split()[1].strip('`,')}`" for row in rows if row in shared]:
        lines += [
            f"[Options of several commands](#options-of-several-commands): {', '.join(names)}"
        ]
        lines += [""]
    return "\n".join(lines)


def _argument(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    value = _value(action)
    if not action.option_strings:
        name = f"`{value}`"
    else:
        name = ", ".join(f"`{f'{option} {value}'.strip()}`" for option in action.option_strings)
    help_text = parser._get_formatter()._expand_help(action) if action.help else ""
    required = " (required)" if action.option_strings and action.required else ""
    return f"| {_cell(name)} | {_cell(_line(help_text))}{required} |"


def _value(action: argparse.Action) -> str:
    """How the value of an argument is written: `MAP`, `[OBJECT ...]`, `{a,b}`, or nothing."""
    if action.nargs == 0:
        return ""
    if action.metavar is None and action.choices is not None:
        text = "{" + ",".join(map(str, action.choices)) + "}"
    elif isinstance(action.metavar, tuple):
        return " ".join(action.metavar)
    else:
        text = action.metavar or action.dest.upper()
    many = {"?": f"[{text}]", "*": f"[{text} ...]", "+": f"{text} [{text} ...]"}
    if isinstance(action.nargs, int):
        return " ".join([text] * action.nargs)
    return many.get(action.nargs or "", text)


def queries() -> str:
    """The shipped query files, by their headers."""
    from kg.maps.query.query_files import shipped_queries

    parts = [
        f"# Query files\n\n{_MADE}\nThe files of `queries/`, each by its own header. "
        "`hereabouts ask MAP NAME -p PARAMETER=VALUE`; a parameter without a default must be "
        "given. The cost of an answer: a *lookup* grows with what was asked for, a *listing* with "
        "what there is of it, a *survey* goes through the whole map.\n"
    ]
    for question in sorted(shipped_queries(), key=lambda each: each.name):
        parts.append(f"## {question.name}\n\n{question.summary}. A {question.answer}.\n")
        if question.parameters:
            rows = [
                f"- `{p.name}` ({', '.join((p.type, *([] if p.default is None else [p.default])))})"
                f": {p.about}"
                for p in question.parameters
            ]
            parts.append("\n".join([*rows, ""]))
        parts.append(f"Columns: {', '.join(f'`{c}`' for c in question.columns)}.\n")
    return "\n".join(parts)


def vocabulary() -> str:
    """The terms and categories of the shipped ontologies."""
    from kg.knowledge.ontology.import_closure import load_with_imports
    from kg.model.resources import ONTOLOGIES

    return vocabulary_page(load_with_imports(ONTOLOGIES).quads)


def api() -> str:
    """The public Python names, with their signatures and docstrings."""
    parts = [
        f"# Python API\n\n{_MADE}\nThe names of the module `hereabouts`. A program may rely on "
        "them; everything else may change between versions. "
        "[Use a map from Python](../how-to/python.md) shows how they are used. "
        "`hereabouts.__version__` is the installed version.\n"
    ]
    described = {"__version__"}
    for section, names in PUBLIC.items():
        parts += [f"## {section}\n", *map(_public, names)]
        described |= {*names}
    if described != {*hereabouts.__all__}:
        raise SystemExit(f"not both public and described: {described ^ {*hereabouts.__all__}}")
    return "\n".join(parts)


def _public(name: str) -> str:
    value = getattr(hereabouts, name)
    lines = [f"### `{name}`", ""]
    if not (inspect.isclass(value) and issubclass(value, Exception)):
        lines += ["```python", _signature(name, value), "```", ""]
    lines += [_prose(value), ""]
    if inspect.isclass(value) and not issubclass(value, Exception):
        lines += _members(value)
    return "\n".join(lines)


def _members(owner: type) -> list[str]:
    """A row for each public method and property with a docstring."""
    rows = []
    for name, value in inspect.getmembers_static(owner):
        if name.startswith("_") or not (inspect.isroutine(value) or isinstance(value, property)):
            continue
        bare = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if not getattr(bare, "__doc__", None) or not _is_ours(bare):
            continue
        shown = name if isinstance(bare, property) else _signature(name, bare)
        rows.append(f"| `{_cell(_line(shown))}` | {_cell(_line(_first(bare)))} |")
    for name, part in typing.get_type_hints(owner).items():
        if part.__module__ in _PARTS:
            prefixed = (row.replace("| `", f"| `{name}.", 1) for row in _members(part)[2:-1])
            rows += prefixed
    return ["| member | |", "|---|---|", *rows, ""] if rows else []


def _is_ours(member: object) -> bool:
    function = member.fget if isinstance(member, property) else member
    module = getattr(function, "__module__", "") or ""
    return module.split(".")[0] in {"hereabouts", "kg", "perception", "mapping", "planner"}


class _Default:
    """A default that is shown as a call without arguments."""

    def __init__(self, kind: type) -> None:
        self._kind = kind

    def __repr__(self) -> str:
        return f"{self._kind.__name__}()"


def _signature(name: str, value: object) -> str:
    try:
        signature = inspect.signature(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return name
    kept = [
        # of a value with many fields its own entry lists the defaults
        p.replace(default=_Default(type(p.default))) if is_dataclass(p.default) else p
        for p in signature.parameters.values()
        if p.name not in ("self", "cls")
    ]
    text = f"{name}{signature.replace(parameters=kept)}"
    text = re.sub(r"\bat 0x[0-9a-f]+", "", text).replace("'", "")
    if len(text) <= 100 or not kept:
        return text
    returned = "" if " -> " not in text else " ->" + text.rpartition(" ->")[2]
    stars, lines = False, []
    for parameter in kept:
        if parameter.kind is parameter.KEYWORD_ONLY and not stars:
            stars = True
            lines.append("    *,")
        lines.append(f"    {str(parameter).replace(chr(39), '')},")
    return "\n".join([f"{name}(", *lines, f"){returned}"])


def _prose(value: object) -> str:
    return (inspect.getdoc(value) or "").replace("\n::\n", "\n").strip()


def _first(value: object) -> str:
    return (inspect.getdoc(value) or "").partition("\n\n")[0]


def _line(text: str) -> str:
    return " ".join(text.split())


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


PAGES: Final[dict[str, Callable[[], str]]] = {
    "commands.md": commands,
    "queries.md": queries,
    "vocabulary.md": vocabulary,
    "api.md": api,
}

if __name__ == "__main__":
    sys.exit(main())
