"""Ask the map: a question in English, a shipped query, a query file, or SPARQL text.

`hereabouts queries` lists the shipped queries, and questions that they answer.

example: hereabouts ask kitchen.map "where is the cup?"
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import MAP_HELP, declare, moment_of, name_value, plain_value
from hereabouts.cli.console import (
    counted,
    json_value,
    note,
    print_answer,
    print_table,
    with_map,
    without_details,
    write,
    write_json,
)
from hereabouts.cli.name import note_unnamed
from kg.model.errors import QueryParameterError

if TYPE_CHECKING:
    from kg.maps.query.evaluation import Table
    from kg.maps.semantic_map import SemanticMap

#: queries whose answers leave out things without a name
_LISTS: Final = ("summary", "objects", "objects-in-place")


_OPTIONS = f"""
[MAP]                           {MAP_HELP}
--member MAP ...                ask this map merged with others instead of MAP (repeatable)
[QUESTION|NAME|FILE.rq|SPARQL] -> question
                                question such as 'where is the cup?', shipped query, query file, or
                                SPARQL text
-e, --execute SPARQL            SPARQL text
-p, --parameter NAME=VALUE ...  a parameter of the query (repeatable)
--all                           list objects of any existence, not only those of 0.5 and above
--language LANG                 language of labels in shipped queries, and of the question: de, or
                                de,fr
--format                        how to print the answer (ttl: CONSTRUCT and DESCRIBE only; default:
                                table)
--json -> format                as --format json
--explain                       print all columns, and behind an answer in words its rows and the
                                query that has them
--at
"""


def add(parser: argparse.ArgumentParser) -> None:
    formats = {"choices": ("table", "json", "csv", "ttl"), "default": "table"}
    declare(parser, _OPTIONS, language={"default": ""}, format=formats)


def run(arguments: argparse.Namespace) -> int:
    if arguments.member and arguments.question is None:
        # with members there is no MAP: the first word is the query
        arguments.map, arguments.question = None, arguments.map
    if (arguments.question is None) == (arguments.execute is None):
        arguments.usage_error("give one query: NAME, FILE.rq or SPARQL, or -e SPARQL")
    if (arguments.map is None) == (not arguments.member):
        arguments.usage_error("give MAP, or one --member MAP or more, not both")
    if arguments.member and arguments.at is not None:
        arguments.usage_error("--at needs one MAP: each map counts its own transactions")
    parameters = name_value(arguments.parameter)
    if arguments.at is not None:
        arguments.at = moment_of(arguments.at)
    with ExitStack() as opened:
        semantic_map = opened.enter_context(_opened(arguments))
        _note_frames(semantic_map)
        if _is_plain(semantic_map, arguments):
            return _answer_plainly(semantic_map, arguments, opened)
        answer, shipped = _ask(semantic_map, arguments, parameters, opened)
        _print(answer, arguments, semantic_map if shipped else None)
        if arguments.format == "table" and arguments.at is None and arguments.question in _LISTS:
            place = parameters.get("place")
            where = None if place is None else semantic_map.resolve("place", str(place))
            note_unnamed(semantic_map, where)
    return 0


def _opened(arguments: argparse.Namespace) -> SemanticMap:
    """The map, or the members merged into one in memory."""
    from kg.serving.opening import open_map

    if not arguments.member:
        return open_map(arguments.map, read_only=True)
    from kg.serving.publishing import merged

    return merged(arguments.member)


def _note_frames(semantic_map: SemanticMap) -> None:
    """Note which maps of several have no known way to the frame of the first."""
    from kg.maps.facts.coordinate_frames import apart_from, maps_in

    if len(maps_in(semantic_map.engine)) > 1:
        apart = [frame.title for frame in apart_from(semantic_map.engine, semantic_map.base)]
        if apart:
            note(
                f"no way is known from the frame of {semantic_map.description.title} to that of "
                f"{', '.join(apart)}: coordinates of different maps do not compare"
            )


def _is_plain(semantic_map: SemanticMap, arguments: argparse.Namespace) -> bool:
    """Whether the query is a plain question; one word unless it is like a query's name."""
    from difflib import get_close_matches

    from kg.maps.query.query_files import shipped_names

    text = arguments.question
    if text is None or arguments.parameter or text in shipped_names():
        return False
    from planner.questions.recognition import is_known_word, is_plain  # with rules of a planner

    if not is_plain(text):
        return False
    if len(text.split()) != 1 or is_known_word(semantic_map, text):
        return True
    return not get_close_matches(text, shipped_names())


def _answer_plainly(
    semantic_map: SemanticMap, arguments: argparse.Namespace, opened: ExitStack
) -> int:
    from kg.history.timestamps import moment
    from planner.questions.answers import answer_question
    from planner.search.goals.known_objects import map_time

    now = None
    if arguments.at is not None:
        semantic_map = opened.enter_context(semantic_map.at(arguments.at))
        is_number = arguments.at.startswith("#")
        now = map_time(semantic_map) if is_number else moment(arguments.at)
    answer = answer_question(semantic_map, arguments.question, now, arguments.language)
    if arguments.format == "json":
        rows = [dict(zip(answer.columns, map(json_value, row), strict=True)) for row in answer.rows]
        write_json({**answer.to_json(), "rows": rows})
        return 0
    if arguments.format != "table":
        raise QueryParameterError(
            f"an answer in words is no {arguments.format}; the same facts: {answer.command}"
        )
    write(with_map("\n".join(answer.lines)))
    if answer.rows and arguments.explain:
        print_table(*_for_people(semantic_map, answer.columns, answer.rows, arguments))
    if answer.command and arguments.explain:
        note(answer.command)
    return 0


def _ask(
    semantic_map: SemanticMap,
    arguments: argparse.Namespace,
    parameters: Mapping[str, object],
    opened: ExitStack,
) -> tuple[Table, bool]:
    """The answer, and whether its query is shipped; another one runs in an isolated process."""
    from kg.maps.query.query_files import inline_query, resolve_query
    from kg.store.folder import is_url

    values = {name: plain_value(str(text)) for name, text in parameters.items()}
    if arguments.execute is not None:
        question = inline_query(arguments.execute, values)
    else:
        question = resolve_query(arguments.question, values)
    for parameter in question.parameters:
        if parameter.type == "category" and parameter.name in values:
            _note_meaning(semantic_map, str(parameters[parameter.name]))
    if arguments.all and any(parameter.name == "least" for parameter in question.parameters):
        parameters = {"least": "0", **parameters}
    if not question.shipped and not is_url(arguments.map or ""):
        from kg.serving.workers.local_evaluation import query_isolated

        answer = query_isolated(
            semantic_map, question, parameters, at=arguments.at, language=arguments.language
        )
        return answer, False
    if arguments.at is not None:
        semantic_map = opened.enter_context(semantic_map.at(arguments.at))
    answer = semantic_map.query(question, language=arguments.language, **parameters)
    return answer, question.shipped


def _note_meaning(semantic_map: SemanticMap, name: str) -> None:
    """Note how the name of a category was understood, where it is not the category's own."""
    from kg.knowledge.words.meaning import understand

    if semantic_map.catalogue.get(name) is None:
        meaning = understand(semantic_map.catalogue, name)
        if meaning.categories and meaning.how != "spelling":
            note(meaning.note)


def _print(answer: Table, arguments: argparse.Namespace, shipped: SemanticMap | None) -> None:
    """Print an answer; `shipped` is the map of a shipped query.

    Its table has titles of places, as sentences have them, and details only with `--explain`.
    """
    for line in answer.notes:
        note(line)
    if arguments.format != "table":
        write(answer.serialise(arguments.format))
        return
    if shipped is None:
        print_table(answer.columns, answer.rows)
    else:
        print_table(*_for_people(shipped, answer.columns, answer.rows, arguments))
    note(counted(len(answer.rows), "row"))


def _for_people(
    semantic_map: SemanticMap,
    columns: Sequence[str],
    rows: Sequence[Sequence[object]],
    arguments: argparse.Namespace,
) -> tuple[Sequence[str], Sequence[Sequence[object]]]:
    """A table with names of places as sentences have them; with details for `--explain` alone."""
    if "belief" in columns and "category" in columns:
        from kg.model.place_names import plain_place

        at = columns.index("category")
        rows = [[*r[:at], plain_place(str(r[at] or "")), *r[at + 1 :]] for r in rows]
    if "place" in columns:
        from planner.search.goals.place_names import titles_by_label

        titles, at = titles_by_label(semantic_map), columns.index("place")
        rows = [[*r[:at], titles.get(str(r[at]), r[at]), *r[at + 1 :]] for r in rows]
    return (columns, rows) if arguments.explain else without_details(columns, rows)


def add_queries(parser: argparse.ArgumentParser) -> None:
    declare(parser, "--json")


def queries(arguments: argparse.Namespace) -> int:
    """List the shipped queries with their parameters."""
    from kg.maps.query.query_files import shipped_queries

    rows, records = [], []
    for query in shipped_queries():
        given = (
            f"{p.name}{'' if p.default is None else f'={p.default}'}" for p in query.parameters
        )
        rows.append((query.name, query.summary, ", ".join(given), " / ".join(query.asked[:1])))
        records.append(
            {
                "name": query.name,
                "summary": query.summary,
                "asked": list(query.asked),
                "parameters": [asdict(parameter) for parameter in query.parameters],
                "columns": list(query.columns),
            }
        )
    print_answer(("query", "summary", "parameters", "asked as"), rows, arguments.json, records)
    return 0
