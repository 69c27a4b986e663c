"""List the shipped queries with their parameters."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from planner.cli.arguments import add_json
from planner.cli.console import print_table, write_json


def add(parser: argparse.ArgumentParser) -> None:
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    from kg.maps.query.query_files import shipped_queries

    questions = shipped_queries()
    if arguments.json:
        write_json(
            [
                {
                    "name": question.name,
                    "summary": question.summary,
                    "parameters": [asdict(parameter) for parameter in question.parameters],
                    "columns": list(question.columns),
                }
                for question in questions
            ]
        )
        return 0
    rows = [
        (
            question.name,
            question.summary,
            ", ".join(
                p.name if p.default is None else f"{p.name}={p.default}"
                for p in question.parameters
            ),
        )
        for question in questions
    ]
    print_table(("question", "asks", "parameters"), rows)
    return 0
