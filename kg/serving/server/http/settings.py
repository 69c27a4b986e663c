"""Settings and limits of a server."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass, field

from pyoxigraph import NamedNode

from kg.model.errors import ServerError
from kg.serving.server.http.bearer_tokens import BearerTokens

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
