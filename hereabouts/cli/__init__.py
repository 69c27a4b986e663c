"""The command line: modules of commands, each with `add(parser)` and `run(arguments) -> int`.

`add` declares the arguments; `run` executes the command and returns the exit code. The docstring of
the module is the command's help: a summary, a description, and an example. Where a module has
several commands, `log` is the function that runs one and has its help, and `add_log` declares it.

stdout carries the answer, stderr everything else. Exit code 0: done; 1: a `HereaboutsError`,
printed as one line; 2: wrong usage. A bug keeps its traceback.
"""

from __future__ import annotations

import argparse
import atexit
import errno
import gc
import importlib
import os
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from hereabouts.cli.arguments import add_command, join_signed
from hereabouts.cli.console import name_map, note, printable, with_map
from kg.model.errors import (
    ExtensionError,
    HereaboutsError,
    MapNotFoundError,
    RecordingError,
    did_you_mean,
)

#: command -> its module, in the order `hereabouts --help` lists them; with the name of its function
#: where the module has several
COMMANDS = {
    "demo": "demo",
    "map": "map_recording",
    "live": "live",
    "info": "recordings:info",
    "convert": "recordings:convert",
    "ask": "ask",
    "queries": "ask:queries",
    "find": "find",
    "search": "search",
    "status": "status",
    "why": "history:why",
    "log": "history:log",
    "diff": "history:diff",
    "compact": "history:compact",
    "assert": "changes:assertion",
    "name": "name",
    "labels": "name:labels",
    "retract": "changes:retract",
    "update": "changes:update",
    "restore": "changes:restore",
    "rooms": "floor_plan:rooms",
    "plot": "floor_plan:plot",
    "floor": "floor_plan:floor",
    "serve": "serve",
    "mcp": "mcp",
    "publish": "serve:publish",
    "export": "export",
    "import": "imports",
    "describe": "describe:describe",
    "check": "describe:check",
    "ontology": "ontology",
    "models": "models",
    "teach": "teach",
}

#: commands of `lab`, a distribution of its own (or the folder of that name in a clone)
LAB_COMMANDS = ("evaluate", "simulate", "thesis")

#: commands whose first argument is a map, those first that change nothing
_READERS = ("ask", "find", "status", "why", "log", "diff", "rooms", "describe")
_WITH_MAP = (
    *_READERS,
    *("search", "compact", "assert", "name", "labels", "retract", "update", "restore"),
    *("plot", "floor", "serve", "mcp", "publish", "export"),
)

#: options that name what a command writes
_OUTPUTS = ("output", "picture", "pictures", "features", "mcap", "rerun", "review")

#: argparse's message for an argument that is none of its choices, and an option in a message
_CHOICE = re.compile(
    r"argument (?P<what>.+): invalid choice: ['\"](?P<given>.*)['\"] \(choose from (?P<known>.*)\)"
)
_OPTION = re.compile(r"(?<!\S)--?[a-z][\w-]*")
_CALLED = {"COMMAND": "command"}  # in place of a metavar
_MAX_CHOICES = 12  # listed in a message


class _Parser(argparse.ArgumentParser):
    """A parser that tells wrong usage in one line, with the command's example."""

    def error(self, message: str) -> NoReturn:
        example = f"; {self.epilog}" if "example:" in (self.epilog or "") else ""
        message = self._with_suggestion(message)
        what = "options" if " " in self.prog else "commands"
        line = f"error: {message}{example}; `{self.prog} --help` lists the {what}\n"
        self.exit(2, line.replace("?; ", "? "))

    def _with_suggestion(self, message: str) -> str:
        """The message with the nearest of the known choices or options, in place of all choices."""
        if choice := _CHOICE.fullmatch(message):
            names = [name.strip(" '\"") for name in choice["known"].split(",")]
            near = did_you_mean(choice["given"], names)
            if near or len(names) > _MAX_CHOICES:
                what = choice["what"]
                what = f"{what} has no" if what.startswith("-") else f"no {_CALLED.get(what, '')}"
                return f"{what.strip()} {choice['given']!r}{near}"
        given = next(iter(_OPTION.findall(message)), None)
        if given is not None and message.startswith("unrecognized arguments"):
            return f"{message}{did_you_mean(given, self._options())}"
        return message

    def _options(self) -> set[str]:
        """The options of the parser and of its commands."""
        parsers = [
            parser
            for action in self._actions
            if isinstance(action, argparse._SubParsersAction)
            for parser in action.choices.values()
        ]
        return {*self._option_string_actions}.union(*(parser._options() for parser in parsers))


def build_parser(commands: Iterable[str] | None = None) -> argparse.ArgumentParser:
    """The parser of the command line, with `commands`; by default all installed."""
    parser = _Parser(
        prog="hereabouts",
        description="A semantic map for robots: RGB-D frames with poses go in; a live knowledge "
        "graph of objects and places comes out.",
        epilog="`hereabouts COMMAND --help` shows a command's options and an example.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for command in _installed() if commands is None else commands:
        _declare(subparsers, command)
    return parser


def _installed() -> tuple[str, ...]:
    return (*COMMANDS, *LAB_COMMANDS) if _has_lab() else (*COMMANDS,)


def _has_lab() -> bool:
    try:
        return find_spec("lab.cli.evaluate") is not None
    except ModuleNotFoundError:
        return False


def _declare(subparsers: argparse._SubParsersAction[_Parser], command: str) -> None:
    """Declare a command by the docstring of its module or function."""
    package = "lab" if command in LAB_COMMANDS else "hereabouts"
    module_name, _, function = COMMANDS.get(command, command).partition(":")
    module = importlib.import_module(f"{package}.cli.{module_name}")
    run = getattr(module, function or "run", None)
    text = run.__doc__ if function else module.__doc__
    parser = add_command(subparsers, command, text or "", run=run)
    getattr(module, f"add_{function}" if function else "add")(parser)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the entry point of the console script."""
    if argv is None:
        atexit.register(gc.freeze)  # the last collection of a process takes 40 ms and frees nothing
        # our matrices are small: numpy's further threads take a core to wait, and save no time
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = (sys.argv[1:] if argv is None else argv) or ["--help"]
    arguments = argparse.Namespace()
    try:
        arguments = build_parser(_needed(words)).parse_args(join_signed(_map_first(words)))
        address = getattr(arguments, "map", None) or getattr(arguments, "into", None)
        if isinstance(address, str):
            name_map(address)
        _check_outputs(arguments)
        return int(arguments.run(arguments))
    except HereaboutsError as error:
        text = _map_as_recording(arguments, error) or str(error)
        print(f"error: {with_map(printable(' '.join(text.split())))}", file=sys.stderr)  # noqa: T201
        return 1
    except BrokenPipeError:
        # the reader of stdout ended (| head); Python must not flush at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        text = f"{printable(str(error.filename)[:60])}... is too long for the name of a file"
        print(f"error: {text}; a shorter one would work", file=sys.stderr)  # noqa: T201
        return 1
    except KeyboardInterrupt:
        print("interrupted: all frames that were fully mapped are kept", file=sys.stderr)  # noqa: T201
        return 130


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Raise GraphError for an output inside the folder of a map, before any work is done."""
    given = (getattr(arguments, name, None) for name in _OUTPUTS)
    paths = [Path(path) for path in given if isinstance(path, str)]
    if paths:
        from kg.store.folder import check_outside_maps

        for path in paths:
            check_outside_maps(path)


def _map_as_recording(arguments: argparse.Namespace, error: HereaboutsError) -> str:
    """The advice for a map that was given in place of a recording."""
    recording = str(getattr(arguments, "recording", ""))
    if not isinstance(error, RecordingError) or not _is_map(recording):
        return ""
    return f"{recording} is a map; `hereabouts describe {shlex.quote(recording)}` shows it"


def _map_first(words: Sequence[str]) -> Sequence[str]:
    """`words` with the map first where it stands last, and with the only one here where none is.

    The map of this folder is taken by commands that change nothing, and told. Raises
    MapNotFoundError where there are several.
    """
    command, given = words[0], [*words[1:]]
    if command not in _WITH_MAP or {"-h", "--help"} & {*given} or _is_address(*given[:1]):
        return words
    if given and (_is_map(given[-1]) or given[-1].endswith(".map")):
        return [command, given[-1], *given[:-1]]
    if command not in _READERS or _is_address(*given):
        return words
    here = sorted(filter(_is_map, Path().iterdir()))
    if len(here) > 1:
        raise MapNotFoundError(f"give one of the maps here: {', '.join(map(str, here))}")
    for only in here:
        note(f"map: {only}")
    return [command, *map(str, here), *given]


def _is_map(path: str | Path) -> bool:
    try:
        return (Path(path) / "store" / "CURRENT").is_file()
    except OSError:  # a text that is too long for a path
        return False


def _is_address(*words: str) -> bool:
    """Whether any of these is the folder of a map, there or not, or the address of a server."""
    return any(
        _is_map(word) or word.endswith(".map") or "://" in word.partition(" ")[0] for word in words
    )


def _needed(words: Sequence[str]) -> Sequence[str]:
    """The commands that parsing `words` needs; all of them if no command comes first."""
    if words and words[0] == "--version":
        return ()
    if words and words[0] in LAB_COMMANDS:
        if not _has_lab():
            raise ExtensionError(
                f"{words[0]} comes with hereabouts-lab, which is not installed; in a clone of "
                "hereabouts: pip install ./lab"
            )
        return words[:1]
    return words[:1] if words[:1] and words[0] in COMMANDS else _installed()


class _Version(argparse.Action):
    """Reads the version only for `--version`, since reading takes longer than parsing."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"hereabouts {_version()}")  # noqa: T201
        parser.exit()


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("hereabouts")
    except PackageNotFoundError:
        return "(not installed)"
