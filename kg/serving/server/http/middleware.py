"""Request guard: checks of host, origin and token; limits of clients; headers; metrics."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from kg.serving.server.http.clients import Upload, client_of
from kg.serving.server.http.problems import Problem, problem_response
from kg.serving.server.http.request_checks import (
    check_origin,
    check_request,
    check_token,
    is_trusted,
)
from kg.serving.server.http.settings import ANY_ORIGIN, Settings
from kg.serving.server.metrics import Metrics

log = logging.getLogger("hereabouts.server")

_SAFE_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'",
}
_ROUTES = frozenset(
    (
        *("sparql", "graphs", "assertions", "changes", "subscribe", "log", "diff", "why"),
        *("state", "timeline"),
        *("timemap", "timegate", "health", "metrics", "find", "pictures", "files", ".well-known"),
        *("console", "queries"),
    )
)
_METHODS = frozenset(("GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"))

#: headers of requests that scripts of other origins may set, and those that only trusted ones may
_READING = (
    *("Content-Type", "Accept", "Accept-Language", "Accept-Datetime", "Last-Event-ID"),
    *("If-None-Match", "Here-Sequence"),
)
_WRITING = ("Authorization", "Prefer", "If-Match", "Here-Confirm")
_EXPOSED = (
    *("Here-Sequence", "Here-Missing", "Retry-After", "ETag", "Link", "Location"),
    *("Memento-Datetime", "Preference-Applied"),
)

_ENDING = problem_response(
    Problem(503, "the server is shutting down; try again later", {"Retry-After": "10"}), None
)


class RequestGuard:
    """Outermost ASGI middleware of every HTTP server of this package.

    The state of a request gets its `client`, and its `upload`.
    """

    def __init__(self, app: ASGIApp, settings: Settings, metrics: Metrics) -> None:
        self._app, self._settings, self._metrics = app, settings, metrics
        self._held: Counter[str] = Counter()  # [bytes] of bodies, by client

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Guard a request; pass lifespan messages on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started, status, begun, counted = time.perf_counter(), 500, False, False
        headers = Headers(scope=scope)

        def count() -> None:
            nonlocal counted
            if not counted:
                counted = True
                self._count(scope, status, time.perf_counter() - started)

        async def guarded(message: Message) -> None:
            nonlocal status, begun
            if message["type"] == "http.response.start":
                status, begun = message["status"], True
                answered = MutableHeaders(scope=message)
                if status == 304 and "Accept-Encoding" not in answered.get("Vary", ""):
                    answered.add_vary_header("Accept-Encoding")  # as with the compressed answer
                self._add_headers(answered, headers.get("origin"))
            elif not message.get("more_body", False):
                # before the last part is sent, so that a client finds its request counted
                count()
            await send(message)

        try:
            early = self._answer_early(scope, headers)
            await (early or self._with_upload)(scope, receive, guarded)
        except asyncio.CancelledError:
            # the server stops, and this response took too long
            if not begun:
                await _ENDING(scope, receive, guarded)
        finally:
            count()

    async def _with_upload(self, scope: Scope, receive: Receive, send: Send) -> None:
        state = scope["state"]
        state["upload"] = Upload(self._settings.limits, self._held, state["client"])
        try:
            await self._app(scope, receive, send)
        finally:
            state["upload"].release()

    def _answer_early(self, scope: Scope, headers: Headers) -> Response | None:
        try:
            self._check(scope, headers)
        except Problem as problem:
            return problem_response(problem, headers.get("accept"))
        if scope["method"] == "OPTIONS":
            return Response(status_code=204, headers={"Allow": "GET, HEAD, POST, PUT, DELETE"})
        return None

    def _check(self, scope: Scope, headers: Headers) -> None:
        check_request(self._settings, scope["http_version"], headers)
        address = scope["client"][0] if scope.get("client") else ""
        scope["state"]["client"] = client_of(self._settings, headers, address)
        if scope["method"] != "OPTIONS":  # a preflight has no token, and gets no data
            check_origin(self._settings, scope["path"], scope["method"], headers)
            check_token(self._settings, scope["path"], headers)

    def _add_headers(self, answer: MutableHeaders, origin: str | None) -> None:
        for name, value in _SAFE_HEADERS.items():
            answer.setdefault(name, value)
        allowed = self._settings.allow_origins
        if allowed:
            answer.add_vary_header("Origin")
        if origin is None or not {origin, ANY_ORIGIN} & {*allowed}:
            return
        trusted = is_trusted(self._settings, origin)
        answer["Access-Control-Allow-Origin"] = origin if trusted else ANY_ORIGIN
        answer["Access-Control-Allow-Methods"] = ", ".join(
            ("GET", "HEAD", "POST", *(("PUT", "DELETE") if trusted else ()))
        )
        answer["Access-Control-Allow-Headers"] = ", ".join(
            (*_READING, *(_WRITING if trusted else ()))
        )
        answer["Access-Control-Expose-Headers"] = ", ".join(_EXPOSED)
        answer["Access-Control-Max-Age"] = "600"
        answer["Cross-Origin-Resource-Policy"] = "cross-origin"

    def _count(self, scope: Scope, status: int, seconds: float) -> None:
        first = scope["path"].split("/")[1] if scope["path"].startswith("/") else ""
        route = f"/{first}" if first in _ROUTES else "/"
        method = scope["method"] if scope["method"] in _METHODS else "other"
        self._metrics.request(route, method, status, seconds)
        # without query string and headers, which may hold secrets
        log.info("%s %r %s %.1f ms", method, scope["path"][:200], status, seconds * 1000)
