"""The tool that answers plain questions."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.map_context import MapContext
from hereabouts.agents.untrusted_text import for_agents
from planner.questions.answers import answer_question
from planner.questions.patterns import MAX_LENGTH


class QuestionTools:
    """The tool on questions in English; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context

    def ask(
        self, question: Annotated[str, Field(min_length=1, max_length=MAX_LENGTH)]
    ) -> a.PlainAnswer:
        """A question in sentences: "where is the cup?", "how many chairs are in the kitchen?" """
        state = self._context.state()
        found = answer_question(self._context.semantic_map, question)
        return a.PlainAnswer(map=state, kind=found.kind, untrusted_answer=for_agents(found.lines))
