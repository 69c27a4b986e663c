"""Checks of the headers of a request.

- the length of headers, since each of them is parsed
- Host, against DNS rebinding
- fetch metadata of browsers (W3C), or the Origin, against web pages of other sites
- the token, where the map is private
- the confirmation of a large deletion
"""

from __future__ import annotations

import ipaddress
import re
from typing import Final

from starlette.datastructures import Headers
from starlette.requests import Request

from kg.serving.server.http.problems import Problem
from kg.serving.server.http.settings import ANY_ORIGIN, Settings, unauthorised
from kg.store.sparql_client import CONFIRM, CONFIRMED

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
