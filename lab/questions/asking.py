"""Asks a map all questions through every interface, and tabulates the scores."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from kg.export.plain_documents import rooms_document
from kg.serving.server import MapServer, Settings
from lab.questions.graph_maps import AskedMap
from lab.questions.mcp_interface import McpInterface
from lab.questions.plain_map import PlainMap
from lab.questions.python_interface import PythonInterface
from lab.questions.question_file import FAMILIES, HouseQuestion
from lab.questions.scoring import score
from lab.questions.sparql_interfaces import HttpInterface, SparqlInterface
from planner.search.plans.find import plan_words

INTERFACES: Final = ("SPARQL", "Python", "HTTP", "MCP")  # of which the answers have to agree
EXPORT: Final = "JSON"  # the plain export, answered by `lab.questions.plain_map`


@dataclass(frozen=True, slots=True)
class Answered:
    """An answer, and its score."""

    map: str  # which kind of map, or "blind"
    interface: str
    question: HouseQuestion
    given: Any

    @property
    def score(self) -> float:
        """0..1."""
        return score(self.question, self.given)


def ask(name: str, asked: AskedMap, questions: Sequence[HouseQuestion]) -> list[Answered]:
    """The answers of one map through all interfaces."""
    with _interfaces(asked) as interfaces:
        return [
            Answered(name, interface, question, answered_by(adapter, question))
            for interface, adapter in interfaces.items()
            for question in questions
            if hasattr(adapter, _method(question))
        ]


def answered_by(adapter: Any, question: HouseQuestion) -> Any:
    """The answer of an adapter, an object with a method for each family."""
    return getattr(adapter, _method(question))(**question.parameters)


def _method(question: HouseQuestion) -> str:
    return question.family.replace(" ", "_")


@contextmanager
def _interfaces(asked: AskedMap) -> Iterator[Mapping[str, Any]]:
    semantic_map = asked.semantic_map

    def planner(words: Sequence[str]) -> dict[str, object]:
        return plan_words(semantic_map, words).to_json()

    with (
        MapServer(semantic_map, Settings(port=0), planner=planner) as server,
        closing(McpInterface(asked, server.url)) as mcp,
        semantic_map.at(asked.since) as then,
    ):
        plain = PlainMap(rooms_document(semantic_map), rooms_document(then))
        http = HttpInterface(asked, server.url)
        yield {
            "SPARQL": SparqlInterface(asked),
            "Python": PythonInterface(asked),
            "HTTP": http,
            "MCP": mcp,
            EXPORT: plain,
        }


def differing(answers: Sequence[Answered]) -> list[list[Answered]]:
    """Answers to each question of a map of which the interfaces disagree."""
    groups: dict[tuple[str, str], list[Answered]] = {}
    for one in answers:
        if one.interface in INTERFACES:
            groups.setdefault((one.map, one.question.id), []).append(one)
    return [group for group in groups.values() if len({_comparable(one) for one in group}) > 1]


def _comparable(one: Answered) -> str:
    given = one.given
    if one.question.type == "position" and given is not None:
        given = [round(float(c), 2) for c in given[:2]]
    elif one.question.type == "time" and given is not None:
        given = round(given)
    return repr(given)


def table(answers: Sequence[Answered], column: str) -> str:
    """Mean scores as Markdown: a row for each family, a column for each `map` or `interface`."""
    columns = list(dict.fromkeys(getattr(one, column) for one in answers))
    lines = [
        "| family | questions | " + " | ".join(columns) + " |",
        "|---" * (len(columns) + 2) + "|",
    ]
    for family in (*FAMILIES, None):
        chosen = [one for one in answers if family in (None, one.question.family)]
        asked = len({one.question.id for one in chosen})
        means = [
            _mean([one.score for one in chosen if getattr(one, column) == name]) for name in columns
        ]
        lines.append(f"| {family or 'all'} | {asked} | " + " | ".join(means) + " |")
    return os.linesep.join(lines)


def _mean(scores: Sequence[float]) -> str:
    return f"{np.mean(scores):.2f}" if scores else "-"
