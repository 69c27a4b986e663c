"""Request guard, the outermost middleware: checks of headers; limits of clients; headers; metrics.

A request is refused by

- the length of headers, since each of them is parsed
- Host, against DNS rebinding
- fetch metadata of browsers (W3C), or the Origin, against web pages of other sites
- the token, where the map is private
- the confirmation of a large deletion
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import re
import time
from collections import Counter
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from kg.serving.server.http.clients import Upload, client_of
from kg.serving.server.http.problems import Problem, problem_response
from kg.serving.server.http.settings import ANY_ORIGIN, Settings, unauthorised
from kg.serving.server.metrics import Metrics
from kg.store.sparql_client import CONFIRM, CONFIRMED

log = logging.getLogger("hereabouts.server")

_HOST: Final = re.compile(r"(\[[0-9a-fA-F:.]+\]|[^\s:@/\[\]]+)(:[0-9]{0,5})?")
#: paths that links of other sites may not open, since opening them runs a query
_NO_LINKS: Final = frozenset(
    (
        *("sparql", "subscribe", "changes", "log", "diff", "why", "state", "timeline"),
        *("find", "mcp"),
    )
)
MAX_HEADER: Final = 4000  # [bytes] of a value
_UNREAD: Final = frozenset((b"cookie", b"referer"))  # may be longer: the server does not parse them
_ENTRIES: Final = frozenset(("/", "/console"))
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


def check_request(settings: Settings, http_version: str, headers: Headers) -> None:
    """Check what every request has to fulfil, before anything is parsed.

    Raises Problem: 400 for a doubtful body or an invalid Host, 421 for the Host of another server,
    431 for a long header.
    """
    check_framing(http_version, headers)
    for name, value in headers.raw:
        if len(value) > MAX_HEADER and name not in _UNREAD:
            what = f"the header {name.decode('latin-1')[:40]} has {len(value)} bytes"
            raise Problem(431, f"{what}, may have {MAX_HEADER}")
    check_host(settings, headers)


def check_host(settings: Settings, headers: Headers) -> None:
    """Raise Problem: 400 for an invalid Host, 421 for the Host of another server."""
    host = headers.get("host", "")
    match = _HOST.fullmatch(host)
    if match is None:
        raise Problem(400, f"invalid Host {host[:100]!r}; write a name or an address, and a port")
    name = match[1].lower()
    if name in settings.hosts or (not settings.loopback and _is_address(name)):
        return
    if settings.loopback:
        raise Problem(421, "this server answers only to localhost and to its own address")
    name = name[:100]
    raise Problem(421, f"{name} is not a name of this server; start it with --public-host {name}")


def check_framing(http_version: str, headers: Headers) -> None:
    """Raise Problem 400, and close, if a proxy could see another end of the body (RFC 9112, 6.3).

    h11 refuses lengths that are invalid or differ.
    """
    if "transfer-encoding" not in headers:
        return
    if "content-length" in headers or http_version == "1.0":
        raise Problem(
            400,
            "Transfer-Encoding beside Content-Length, or in HTTP/1.0; send one of the two",
            {"Connection": "close"},
        )


def check_origin(settings: Settings, path: str, method: str, headers: Headers) -> None:
    """Raise Problem 403 for a request of a browser on behalf of another site.

    Browsers name the site in Sec-Fetch-Site, but over plain HTTP only to this machine: elsewhere
    the Origin has to be the one of the Host. Links to pages of the map are allowed. Scripts, forms
    and pictures are refused, except those of `allow_origins`; any origin allowed means reading.
    """
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site is None:
        is_foreign = origin is not None and not _is_of_host(origin, headers.get("host", ""))
    else:
        is_foreign = site.lower() not in ("none", "same-origin")
    is_read = method in ("GET", "HEAD") or (method == "POST" and path.rstrip("/") == "/sparql")
    if not is_foreign or is_trusted(settings, origin):
        return
    if ANY_ORIGIN in settings.allow_origins and is_read:
        return
    is_link = headers.get("sec-fetch-mode") == "navigate" and method in ("GET", "HEAD")
    in_frame = headers.get("sec-fetch-dest", "document") != "document"
    if not is_link or in_frame or path.strip("/").partition("/")[0] in _NO_LINKS:
        raise Problem(
            403,
            "web pages of other sites may not use this server; start it with --allow-origin ORIGIN",
        )


def is_trusted(settings: Settings, origin: str | None) -> bool:
    """Whether scripts of web pages from `origin` may do all that a program may."""
    return origin != ANY_ORIGIN and origin in settings.allow_origins


def _is_of_host(origin: str, host: str) -> bool:
    scheme, _, name = origin.lower().partition("://")
    port = {"http": ":80", "https": ":443"}.get(scheme)
    return port is not None and name.removesuffix(port) == host.lower().removesuffix(port)


def check_token(settings: Settings, path: str, headers: Headers) -> None:
    """Raise Problem 401 if the map is private and the request has none of its tokens.

    The entry pages and their scripts need no token, since they contain no data of the map.
    """
    if path in _ENTRIES or path.startswith("/files/"):
        return
    if not is_admitted(settings, headers):
        raise private_map()


def is_admitted(settings: Settings, headers: Headers) -> bool:
    """Whether the map is public, or the request has one of its tokens."""
    authorization = headers.get("authorization")
    # looks up both, so that timing does not reveal which kind of token almost matched
    names = [tokens.find(authorization) for tokens in (settings.tokens, settings.read_tokens)]
    return not settings.read_tokens or any(names)


def private_map() -> Problem:
    """The refusal of a request without a token."""
    return unauthorised("this map is private: send a header 'Authorization: Bearer TOKEN'")


def is_confirmed(request: Request) -> bool:
    """Whether the client confirms a large deletion by a header.

    Raises Problem 400 for another value of the header.
    """
    given = request.headers.get(CONFIRM)
    if given not in (None, CONFIRMED):
        raise Problem(400, f"{CONFIRM} must be {CONFIRMED!r}, got {given[:40]!r}")
    return given is not None


def _is_address(name: str) -> bool:
    # DNS rebinding needs a name
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True
