"""Request parameters and bodies, read within limits; JSON responses."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from kg.model.iris import whole_number
from kg.serving.server.http.clients import Upload
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.settings import Limits

FORM = "application/x-www-form-urlencoded"
JSON = "application/json"
MAX_FIELDS = 200  # parameters of one request
MAX_LEVELS = 32  # levels of JSON


@dataclass(frozen=True, slots=True)
class RequestParameters:
    """Names and values of a request in their order; names may repeat."""

    pairs: tuple[tuple[str, str], ...]

    def all(self, name: str) -> tuple[str, ...]:
        """Every value of that name."""
        return tuple(value for key, value in self.pairs if key == name)

    def one(self, name: str) -> str | None:
        """The value of that name, or None; Problem 400 for several values."""
        values = self.all(name)
        if len(values) > 1:
            raise Problem(400, f"{name!r} is given {len(values)} times; give one")
        return values[0] if values else None

    def flag(self, name: str) -> bool:
        """Whether that parameter is set; Problem 400 for a value other than 1 and 0."""
        value = self.one(name)
        if value not in (None, "0", "1", "false", "true"):
            raise Problem(400, f"{name} is 1 or 0, got {value[:40]!r}")
        return value in ("1", "true")

    def number(self, name: str) -> int | None:
        """The whole number of that name, or None; Problem 400 for another text."""
        value = self.one(name)
        return None if value is None else number_in(value, name)

    def __contains__(self, name: str) -> bool:
        return any(key == name for key, _ in self.pairs)

    def __add__(self, other: RequestParameters) -> RequestParameters:
        return RequestParameters(self.pairs + other.pairs)


def number_in(text: str, name: str) -> int:
    """The whole number that a client sends as `name`; Problem 400 for another text."""
    number = whole_number(text)
    if number is None:
        raise Problem(400, f"{name} must be a number, got {text[:40]!r}")
    return number


def query_parameters(request: Request) -> RequestParameters:
    """The parameters of the URL; Problem 400 if they are not UTF-8."""
    return _parse(request.scope["query_string"], "the URL's query")


def form_parameters(body: bytes) -> RequestParameters:
    """The parameters of a URL-encoded form; Problem 400 if they are not UTF-8."""
    return _parse(body, "the form")


def text(body: bytes) -> str:
    """A body as text; Problem 400 if it is not UTF-8."""
    try:
        return body.decode("utf-8")
    except UnicodeDecodeError as error:
        raise Problem(400, f"the body is not UTF-8 at byte {error.start}") from error


def json_response(content: object, headers: Mapping[str, str] | None = None) -> Response:
    """A response of one line of JSON; raises ValueError for numbers that are not finite."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False)
    return Response(f"{text}\n", media_type=JSON, headers=headers)


async def read_json(request: Request, limits: Limits, members: Iterable[str]) -> Mapping[str, Any]:
    """The body, a JSON object with exactly these `members`.

    Raises Problem: 415 for another media type, 400 for other content, and as `read_body`.
    """
    kind = media_type(request)
    if kind != JSON:
        raise Problem(415, f"a body of type {kind[:100] or '(none)'}; it must be {JSON}")
    return await run_in_threadpool(_json_object, await read_body(request, limits), members)


def _json_object(body: bytes, members: Iterable[str]) -> Mapping[str, Any]:
    try:
        content = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise Problem(400, f"the body is not JSON: {str(error)[:200]}") from error
    if not isinstance(content, dict) or set(content) != {*members}:
        raise Problem(400, f"the body must be a JSON object of {', '.join(members) or 'nothing'}")
    level: list[Any] = [content]
    for _ in range(MAX_LEVELS):
        held = (outer.values() if isinstance(outer, dict) else outer for outer in level)
        level = [inner for values in held for inner in values if isinstance(inner, dict | list)]
        if not level:
            return content
    raise Problem(400, f"the body is JSON of more than {MAX_LEVELS} levels")


def media_type(request: Request) -> str:
    """The body's type, lower case, without its parameters; Problem 400 for another charset."""
    kind, *parameters = request.headers.get("content-type", "").split(";")
    for parameter in parameters:
        name, _, value = parameter.strip().partition("=")
        if name.lower() == "charset" and value.strip('"').lower() not in ("utf-8", "utf8"):
            raise Problem(400, f"the charset must be utf-8, got {value[:40]}")
    return kind.strip().lower()


async def read_body(request: Request, limits: Limits) -> bytes:
    """The whole body.

    Raises Problem: 413 if it is too long, 408 if it does not arrive in time, 415 if it is
    compressed, 503 if bodies of others fill the memory.
    """
    length = request.headers.get("content-length", "0")
    if length.isdigit() and (whole_number(length) or 0) > limits.body:
        raise _too_long(limits)
    encoding = request.headers.get("content-encoding", "identity").strip().lower()
    if encoding != "identity":
        works = {"Accept-Encoding": "identity"}
        raise Problem(415, f"content encoding {encoding[:40]!r}; send the body as it is", works)
    try:
        async with asyncio.timeout(limits.body_seconds):
            return await _collect(request, request.state.upload, limits)
    except TimeoutError as error:
        raise Problem(
            408,
            f"the body did not arrive within {limits.body_seconds:g} s",
            {"Connection": "close"},
        ) from error
    except ClientDisconnect as error:
        raise Problem(400, "the client left before the body was complete") from error


async def _collect(request: Request, upload: Upload, limits: Limits) -> bytes:
    body = bytearray()
    async for chunk in request.stream():
        if len(body) + len(chunk) > limits.body:
            raise _too_long(limits)
        upload.hold(len(body) + len(chunk))
        body += chunk
    return bytes(body)


def _too_long(limits: Limits) -> Problem:
    # the rest of the body is not read, so the connection cannot be used again
    return Problem(413, f"a body may have {limits.body} bytes", {"Connection": "close"})


def _parse(raw: bytes, what: str) -> RequestParameters:
    try:
        pairs = parse_qsl(
            raw.decode("utf-8"),
            keep_blank_values=True,
            encoding="utf-8",
            errors="strict",
            max_num_fields=MAX_FIELDS,
        )
    except UnicodeDecodeError as error:
        raise Problem(400, f"{what} is not UTF-8") from error
    except ValueError as error:
        raise Problem(400, f"{what} has more than {MAX_FIELDS} parameters") from error
    return RequestParameters(tuple(pairs))
