"""List the shipped queries with their parameters."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import print_table, write_json


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, "--json")


def run(arguments: argparse.Namespace) -> int:
    from kg.maps.query.query_files import shipped_queries

    querys = shipped_queries()
    if arguments.json:
        write_json(
            [
                {
                    "name": query.name,
                    "summary": query.summary,
                    "asked": list(query.asked),
                    "parameters": [asdict(parameter) for parameter in query.parameters],
                    "columns": list(query.columns),
                }
                for query in querys
            ]
        )
        return 0
    rows = [
        (
            query.name,
            query.summary,
            ", ".join(
                p.name if p.default is None else f"{p.name}={p.default}" for p in query.parameters
            ),
            " / ".join(query.asked[:1]),
        )
        for query in querys
    ]
    print_table(("query", "summary", "parameters", "asked as"), rows)
    return 0
