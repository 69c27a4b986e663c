"""Static parts of pages: `/files`, `/pictures`, and the shipped questions, `/queries`."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.maps.query.label_languages import preferred_languages
from kg.maps.query.query_files import ParameterizedQuery, find_query, shipped_queries
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError, UnknownQueryError
from kg.model.iris import whole_number
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import QUERY
from kg.serving.server.http.bodies import json_response, query_parameters
from kg.serving.server.http.problems import Problem

_TYPES: Final = {"css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}


async def page_file(serving: AppState, request: Request) -> Response:
    """A file of the pages; Problem 404 for an unknown name."""
    name, known = request.path_params["name"], _files()
    if name not in known:
        raise Problem(404, f"no file {name[:100]!r}; there are: {', '.join(known)}")
    body = known[name].read_bytes()
    # revalidated each time: modules of two versions do not fit together
    headers = {"ETag": f'"{sha256(body).hexdigest()[:16]}"', "Cache-Control": "no-cache"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(body, media_type=_TYPES[name.rpartition(".")[2]], headers=headers)


@cache
def _files() -> dict[str, Traversable]:
    folder = files("kg.serving.server").joinpath("files")
    found = {one.name: one for one in folder.iterdir()}
    found |= {f"vendor/{one.name}": one for one in folder.joinpath("vendor").iterdir()}
    return {name: found[name] for name in sorted(found) if name.rpartition(".")[2] in _TYPES}


async def picture(serving: AppState, request: Request) -> Response:
    """The JPEG of `/object/NUMBER`."""
    number, semantic_map = str(request.path_params["number"]), serving.semantic_map
    data = None
    if whole_number(number) is not None:
        iri = f"{semantic_map.base}object/{number}"
        data = await run_in_threadpool(semantic_map.picture, iri)
    if data is None:
        return Response(status_code=204)
    return Response(data, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})


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
