"""Offer the map to language-model agents as tools (Model Context Protocol).

The protocol runs over stdin and stdout, or with --http at the path /mcp of an address. Agents only
read; with --write they assert and retract too. The map may be mapped meanwhile.

example: hereabouts mcp kitchen.map --http 8009
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare, end_at_latest, end_on_signal
from hereabouts.cli.console import note
from kg.model.errors import RemoteError, ServerError

if TYPE_CHECKING:
    from collections.abc import Callable

    from kg.maps.semantic_map import SemanticMap
    from kg.serving.server import Settings
    from kg.serving.workers.local_evaluation import LimitedQueries

_INTERRUPTED = 130  # exit code, as shells have it


_OPTIONS = """
MAP
--http [HOST:]PORT      streamable HTTP instead of stdio (HOST: 127.0.0.1; port 0 takes a free one)
--token-file FILE       with --http: file with lines of NAME TOKEN; each request needs one of the
                        tokens
--public-host NAME ...  with --http: host name of this server for other machines (repeatable)
--write                 let agents assert and retract; the author is --by, with --http the holder of
                        the request's token, for a served map the holder of that map's token
--by NAME               author of changes by agents in a folder
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, http=_address)


def run(arguments: argparse.Namespace) -> int:
    _check_options(arguments)
    if importlib.util.find_spec("mcp") is None:
        raise ServerError("this needs the package mcp: pip install 'hereabouts[mcp]'")
    from hereabouts.agents.map_context import MapContext
    from hereabouts.agents.tool_server import PATH, ToolHttpServer, tool_server
    from kg.maps.facts.coordinate_frames import check_one_map
    from kg.serving.opening import open_map, watch_map
    from kg.serving.workers.isolation import hide_memory
    from kg.serving.workers.local_evaluation import LimitedQueries

    hide_memory()
    settings, author = _settings(arguments), _author(arguments)
    access = "reading and writing" if arguments.write else "reading only"
    with (
        (open_map if arguments.write else watch_map)(arguments.map) as semantic_map,
        LimitedQueries(semantic_map) as queries,
    ):
        check_one_map(semantic_map.engine, arguments.map)
        context = MapContext(semantic_map, author)
        # only this subscription notices that others change the ontology of a served map
        semantic_map.subscriptions.listen(lambda change: None)
        if settings is None:
            _end_on_signals(queries, semantic_map)
            note(f"tools of {semantic_map.description.title} on stdin and stdout ({access})")
            tool_server(context, queries).run("stdio")
        else:
            server = ToolHttpServer(context, queries, settings)
            url = server.url.rstrip("/") + PATH
            note(f"tools of {semantic_map.description.title} at {url} ({access}); Ctrl+C ends")
            signal.signal(signal.SIGTERM, end_on_signal)
            server.run(on_signal=end_at_latest)
    return 0


def _end_on_signals(queries: LimitedQueries, semantic_map: SemanticMap) -> None:
    """Close the map and exit on SIGTERM and Ctrl+C, since a thread that reads stdin never ends."""

    def end(number: int, frame: object) -> None:
        end_at_latest()
        queries.close()
        semantic_map.close()
        os._exit(0 if number == signal.SIGTERM else _INTERRUPTED)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)


def _check_options(arguments: argparse.Namespace) -> None:
    from kg.store.folder import is_url

    over_http = arguments.http is not None
    folder_on_stdio = not over_http and not is_url(arguments.map)
    if (arguments.token_file or arguments.public_host) and not over_http:
        arguments.usage_error("--token-file and --public-host need --http")
    if arguments.by is not None and not (arguments.write and folder_on_stdio):
        arguments.usage_error(
            "--by needs --write to a folder over stdio; elsewhere tokens name the authors"
        )
    if arguments.write and over_http and not arguments.token_file:
        arguments.usage_error("--write with --http needs tokens: --token-file FILE")
    if arguments.write and folder_on_stdio and not (arguments.by or "").strip():
        arguments.usage_error("--write to a folder needs an author: --by NAME")


def _author(arguments: argparse.Namespace) -> Callable[[], str] | None:
    """The author of changes; None without --write. Raises RemoteError if a token is missing."""
    from hereabouts.agents.tool_server import token_holder
    from kg.store.credentials import HINT, token_for
    from kg.store.folder import is_url

    if not arguments.write:
        return None
    if is_url(arguments.map) and token_for(arguments.map) is None:
        raise RemoteError(f"writing to this map needs a token; {HINT}")
    if arguments.http is not None:
        return token_holder
    return lambda: arguments.by or ""


def _settings(arguments: argparse.Namespace) -> Settings | None:
    from kg.serving.server import BearerTokens, Settings

    if arguments.http is None:
        return None
    host, port = arguments.http
    tokens = BearerTokens.load(arguments.token_file) if arguments.token_file else BearerTokens()
    public_hosts = tuple(arguments.public_host)
    return Settings(host, port, tokens, public=True, public_hosts=public_hosts)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and int(port) < 65536):
        raise argparse.ArgumentTypeError(f"needs a port, or HOST:PORT, got {text!r}")
    return host.strip("[]") or "127.0.0.1", int(port)
