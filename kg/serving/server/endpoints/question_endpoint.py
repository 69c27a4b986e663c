"""`/queries`: the shipped questions; `/queries/NAME?x=1`: a question with parameters as SPARQL."""

from __future__ import annotations

from functools import cache

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.maps.query.label_languages import preferred_languages
from kg.maps.query.query_files import ParameterizedQuery, find_query, shipped_queries
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError, UnknownQueryError
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import QUERY
from kg.serving.server.http.bodies import json_response, query_parameters
from kg.serving.server.http.problems import Problem


async def questions(serving: AppState, request: Request) -> Response:
    """Predeclared prefixes and the shipped questions with their parameters, as JSON."""
    return json_response(await run_in_threadpool(_content))


@cache
def _content() -> dict[str, object]:
    described = [_described(question) for question in shipped_queries()]
    return {"prefixes": dict(v.PREFIXES), "queries": described}


def _described(question: ParameterizedQuery) -> dict[str, object]:
    parameters = [
        {"name": one.name, "type": one.type, "default": one.default, "about": one.about}
        for one in question.parameters
    ]
    return {
        "name": question.name,
        "summary": question.summary,
        "asked": list(question.asked),
        "parameters": parameters,
        "columns": list(question.columns),
    }


async def question(serving: AppState, request: Request) -> Response:
    """A shipped question as SPARQL; raises QueryParameterError for invalid values.

    Raises Problem: 404 where there is no such question, 400 where a parameter is given twice.
    """
    try:
        found = find_query(request.path_params["name"])
    except UnknownQueryError as error:
        raise Problem(404, str(error), kind=type(error).__name__) from error
    given = query_parameters(request)
    values = {name: given.one(name) for name in dict(given.pairs)}
    language = values.pop("language", None) or _accepted(request)
    text = await run_in_threadpool(found.bind, values, serving.semantic_map.resolve, language)
    body = "\n".join(line for line in text.split("\n") if not line.startswith("#+"))
    headers = {"Vary": "Accept-Language"}
    return Response(f"{body.strip()}\n", media_type=QUERY, headers=headers)


def _accepted(request: Request) -> str:
    """The languages that a client accepts; none where its header has another form."""
    text = request.headers.get("accept-language", "")
    try:
        preferred_languages(text)
    except QueryParameterError:
        return ""
    return text
