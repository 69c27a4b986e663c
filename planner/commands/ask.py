"""`hereabouts ask`: any question on the map."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from planner.commands.arguments import MAP_HELP, name_value, plain_value
from planner.commands.console import note, print_table, write

if TYPE_CHECKING:
    from kg.questions import Table


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "ask",
        help="ask the map a shipped question, a query file, or any SPARQL",
        description="Ask the map. `hereabouts queries` lists the shipped questions.",
        epilog="example: hereabouts ask kitchen.map objects-within-radius -p x=0 -p y=1",
    )
    parser.add_argument("map", metavar="MAP", nargs="?", help=MAP_HELP)
    parser.add_argument(
        "--member",
        action="append",
        default=[],
        metavar="MAP",
        help="ask this map instead of MAP (repeatable: each row says which map it is from)",
    )
    parser.add_argument(
        "question", nargs="?", metavar="NAME|FILE.rq", help="shipped question or query file"
    )
    parser.add_argument("-e", "--execute", metavar="SPARQL", help="SPARQL text to run instead")
    parser.add_argument(
        "-p",
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the question (repeatable)",
    )
    parser.add_argument(
        "--format",
        choices=("table", "json", "csv", "ttl"),
        default="table",
        help="how to print the answer (ttl: CONSTRUCT and DESCRIBE only; default: table)",
    )
    parser.add_argument(
        "--json", action="store_const", const="json", dest="format", help="as --format json"
    )
    parser.add_argument(
        "--at", metavar="TIME", help="ask the map as believed then: ISO 8601, or #42 (transaction)"
    )
    parser.set_defaults(run=run, usage_error=parser.error)


def run(arguments: argparse.Namespace) -> int:
    """Ask, and print the answer."""
    from kg.semantic_map import SemanticMap

    if arguments.member and arguments.question is None:
        # no MAP beside members: the first word is the question
        arguments.map, arguments.question = None, arguments.map
    if (arguments.question is None) == (arguments.execute is None):
        arguments.usage_error("give a question (NAME or FILE.rq), or SPARQL with -e, not both")
    if (arguments.map is None) == (not arguments.member):
        arguments.usage_error("give MAP, or one --member MAP or more, not both")
    parameters = name_value(arguments.parameter)
    if arguments.member:
        return _ask_fleet(arguments, parameters)
    with ExitStack() as opened:
        semantic_map = opened.enter_context(SemanticMap.open(arguments.map, read_only=True))
        if arguments.at is not None:
            semantic_map = opened.enter_context(semantic_map.at(arguments.at))
        if arguments.execute is not None:
            values = {name: plain_value(text) for name, text in parameters.items()}
            answer = semantic_map.ask_text(arguments.execute, **values)
        elif arguments.question.endswith(".rq"):
            answer = semantic_map.ask_file(Path(arguments.question), **parameters)
        else:
            answer = semantic_map.ask(arguments.question, **parameters)
    _print(answer, arguments.format)
    return 0


def _ask_fleet(arguments: argparse.Namespace, parameters: dict[str, str]) -> int:
    """Ask all members; 1 where one of them did not answer, whatever the others said."""
    from kg.fleet import Fleet

    with Fleet(arguments.member) as fleet:
        answer = fleet.query(arguments.execute or arguments.question, **parameters)
    _print(answer.table, arguments.format)
    for member, reason in answer.failures.items():
        note(f"no answer from {member}: {reason}")
    return 1 if answer.failures else 0


def _print(answer: Table, form: str) -> None:
    if form != "table":
        write(answer.serialise(form))
        return
    print_table(answer.columns, answer.rows)
    note(f"{len(answer.rows)} row{'' if len(answer.rows) == 1 else 's'}")
