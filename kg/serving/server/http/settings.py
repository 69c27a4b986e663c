"""Settings and limits of a server, and the bearer tokens (RFC 6750) that it accepts."""

from __future__ import annotations

import hmac
import ipaddress
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from pyoxigraph import NamedNode

from kg.model.errors import ServerError
from kg.serving.server.http.problems import Problem
from kg.store.credentials import read_token_file

MIN_LENGTH = 16  # characters of a token
_TOKEN = re.compile(r"[A-Za-z0-9._~+/-]+=*")  # RFC 6750, section 2.1
_NAME = re.compile(r"[\w.@-]+")


@dataclass(frozen=True, slots=True)
class BearerTokens:
    """Names and their tokens; false without tokens. The repr does not show the tokens."""

    secrets: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """The tokens of a file with lines ``NAME TOKEN`` or ``TOKEN``, and # comments.

        Raises ServerError, which quotes no token, if the file cannot be read, holds no token, or
        holds one that is too short to be safe.
        """
        lines = read_token_file(path).splitlines()
        secrets = tuple(
            _secret(line, f"{path}, line {number}")
            for number, line in enumerate(lines, start=1)
            if line.strip() and not line.lstrip().startswith("#")
        )
        if not secrets:
            raise ServerError(f"the token file {path} holds no token; write lines of NAME TOKEN")
        if len({token for _, token in secrets}) < len(secrets):
            raise ServerError(f"the token file {path} gives one token to two names; make another")
        return cls(secrets)

    def __bool__(self) -> bool:
        return bool(self.secrets)

    def holder(self, authorization: str | None) -> str:
        """The name of the holder of the token in an Authorization header.

        Raises Problem: 403 if the server has no tokens and only reads, 401 for another token.
        """
        if not self.secrets:
            raise Problem(403, "this server only reads; start it with a token file to write")
        if _offered(authorization) is None:
            raise unauthorised("writing needs a header 'Authorization: Bearer TOKEN'")
        name = self.find(authorization)
        if name is None:
            raise unauthorised("this token may not write to this server")
        return name

    def find(self, authorization: str | None) -> str | None:
        """The holder of the token in an Authorization header; None for another token."""
        offered = _offered(authorization)
        if offered is None:
            return None
        # compares all, so that timing reveals nothing about partial matches
        names = [name for name, token in self.secrets if hmac.compare_digest(token, offered)]
        return names[0] if names else None


def unauthorised(message: str) -> Problem:
    """The problem of a request without a valid token (RFC 6750, section 3)."""
    return Problem(401, message, {"WWW-Authenticate": 'Bearer realm="hereabouts"'})


def _offered(authorization: str | None) -> bytes | None:
    scheme, _, given = (authorization or "").partition(" ")
    if scheme.lower() != "bearer" or not given.strip():
        return None
    return given.strip().encode("utf-8", "replace")


def _secret(line: str, where: str) -> tuple[str, bytes]:
    words = line.split()
    name, token = words if len(words) == 2 else ("token", words[-1])
    if len(words) > 2 or not _NAME.fullmatch(name) or not _TOKEN.fullmatch(token):
        raise ServerError(f"{where}: needs NAME TOKEN, a token of letters, digits and ._~+/-")
    if len(token) < MIN_LENGTH:
        raise ServerError(
            f"{where}: the token has {len(token)} characters, needs {MIN_LENGTH} or more; "
            "`openssl rand -hex 24` makes one"
        )
    return name, token.encode()


_HOST_NAME = re.compile(r"[A-Za-z0-9_.-]+")
_ORIGIN = re.compile(r"https?://[^/?#\s@]+|null|\*")
ANY_ORIGIN = "*"  # of `allow_origins`: scripts of all web pages may read


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of requests, so that one client cannot occupy the server."""

    body: int = 8 << 20  # [bytes] of a request, also after decompression
    client_bodies: int = 24 << 20  # [bytes] of the bodies of one client that wait for their answers
    bodies: int = 256 << 20  # [bytes] of the bodies of all clients that wait for their answers
    client_unread: int = 128 << 20  # [bytes] of answers that one address has not read
    result: int = 64 << 20  # [bytes] of an answer
    head: int = 16 << 10  # [bytes] of a request line and its headers
    query_seconds: float = 10.0  # [s] to evaluate one query
    query_memory: int = 1024  # [MB] of one query
    body_seconds: float = 20.0  # [s] to send the body of a request
    idle_seconds: float = 10.0  # [s] to send the head of a request, or without reading an answer
    connections: int = 512
    client_connections: int = 64  # of one address, unless it is a trusted proxy
    staleness: float = 1.0  # [s] of delay until an answer includes the writes of others
    workers: int = 3  # one client may occupy all except one
    feed_clients: int = 256  # followers of changes and of queries
    standing_queries: int = 16
    client_feeds: int = 32  # followers of one client
    client_standing_queries: int = 8
    feed_backlog: int = 256  # changes that may wait for one follower before it is dropped
    feed_memory: int = 1024  # last changes in memory, for followers that reconnect


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a served map; without `tokens` it is read-only."""

    host: str = "127.0.0.1"
    port: int = 8008  # 0 takes a free one
    tokens: BearerTokens = field(default_factory=BearerTokens)
    allow_origins: tuple[str, ...] = ()  # origins of web pages whose scripts may use the server
    public: bool = False  # allow other machines even without tokens
    services: tuple[str, ...] = ()  # SPARQL endpoints that SERVICE may name
    read_tokens: BearerTokens = field(
        default_factory=BearerTokens
    )  # if there are any, the map is private
    public_hosts: tuple[str, ...] = ()  # names by which other machines know this server
    trusted_proxies: tuple[str, ...] = ()  # addresses whose X-Forwarded-For names the client
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        if not (self.loopback or self.tokens or self.read_tokens or self.public):
            raise ServerError(
                f"host {self.host} is open to other machines: give a --token-file, a "
                "--read-token-file, or --public to serve a map anyone there may read"
            )
        if {token for _, token in self.tokens.secrets} & {t for _, t in self.read_tokens.secrets}:
            raise ServerError("a token both writes and only reads; give each file its own tokens")
        for name in self.public_hosts:
            if not _HOST_NAME.fullmatch(name):
                raise ServerError(f"no name of a host: {name!r}; write e.g. maps.example.org")
        for origin in self.allow_origins:
            if not _ORIGIN.fullmatch(origin):
                raise ServerError(
                    f"no origin of web pages: {origin!r}; write it as browsers send it, "
                    "e.g. https://example.org (no path, no slash at the end), or *, for reading"
                )
        for address in self.trusted_proxies:
            _check_address(address)
        for iri in self.services:
            _check_absolute(iri)

    @property
    def loopback(self) -> bool:
        """Whether the server listens on the loopback interface alone."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def hosts(self) -> frozenset[str]:
        """Allowed names in the header Host, in lower case.

        They prevent DNS rebinding, in which the name of a web site resolves to this server. Beyond
        loopback, numeric addresses are allowed too.
        """
        own = f"[{self.host}]" if ":" in self.host else self.host
        names = {"localhost", "127.0.0.1", "[::1]", own, *self.public_hosts}
        return frozenset(name.lower() for name in names)


def _check_address(text: str) -> None:
    try:
        ipaddress.ip_address(text)
    except ValueError as error:
        raise ServerError(f"no address of a proxy: {text!r}; write e.g. 127.0.0.1") from error


def _check_absolute(iri: str) -> None:
    try:
        NamedNode(iri)
    except ValueError as error:
        raise ServerError(
            f"no IRI: {iri!r} ({error}); write it whole, e.g. https://example.org/it"
        ) from error
