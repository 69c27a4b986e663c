"""Bearer tokens of a client, by server.

A token is sent only to its own origin (RFC 6454: scheme, host, port), also for addresses from data
or redirects. ``HEREABOUTS_TOKEN`` belongs to the server in ``HEREABOUTS_SERVER``. The file in
``HEREABOUTS_TOKEN_FILE`` has a line ``ADDRESS TOKEN`` for each further server.
"""

from __future__ import annotations

import logging
import os
import stat
from functools import cache
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from kg.model.errors import RemoteError, ServerError

_log = logging.getLogger("hereabouts.tokens")

TOKEN_VARIABLE: Final = "HEREABOUTS_TOKEN"
SERVER_VARIABLE: Final = "HEREABOUTS_SERVER"
FILE_VARIABLE: Final = "HEREABOUTS_TOKEN_FILE"
HINT: Final = (
    f"one of its tokens goes into {TOKEN_VARIABLE}, and its address into {SERVER_VARIABLE}"
)
_OTHERS: Final = stat.S_IRGRP | stat.S_IWGRP | stat.S_IROTH | stat.S_IWOTH
_PORTS: Final = {"http": 80, "https": 443}


def authorization(url: str) -> dict[str, str]:
    """The Authorization header of a request to `url`; empty without a token for its server.

    Raises RemoteError for an unreadable token file.
    """
    token = token_for(url)
    return {} if token is None else bearer(token)


def bearer(token: str) -> dict[str, str]:
    """The Authorization header for a token (RFC 6750)."""
    return {"Authorization": f"Bearer {token}"}


def token_for(url: str) -> str | None:
    """The token in the environment for the server of a URL, or None."""
    origin = _origin(url)
    for address, token in _tokens():
        if origin is not None and _origin(address) == origin:
            return token
    return None


def read_token_file(path: Path | str) -> str:
    """The text of a file of tokens, of a server or of a client.

    Logs a warning if others than its owner can read or change the file. Raises ServerError where
    it cannot be read.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        mode = Path(path).stat().st_mode
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ServerError(f"cannot read the token file {path}: {reason}") from error
    if stat.S_ISREG(mode) and mode & _OTHERS:
        _warn_of(str(path))
    return text


@cache
def _warn_of(path: str) -> None:
    """Warn once of a token file that others can read or change."""
    _log.warning(
        "other users of this machine can read or change the token file %s: chmod 600 it", path
    )


def _tokens() -> list[tuple[str, str]]:
    server, token = os.environ.get(SERVER_VARIABLE), os.environ.get(TOKEN_VARIABLE)
    own = [(server, token)] if server and token else []
    path = os.environ.get(FILE_VARIABLE)
    return own + (_of_file(path) if path else [])


def _of_file(path: str) -> list[tuple[str, str]]:
    try:
        text = read_token_file(path)
    except ServerError as error:
        raise RemoteError(str(error)) from error
    entries = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 2 or _origin(words[0]) is None:
            raise RemoteError(f"{path}, line {number}: needs ADDRESS TOKEN, http://host:port first")
        entries.append((words[0], words[1]))
    return entries


def _origin(url: str) -> tuple[str, str, int] | None:
    """Scheme, host and port of an HTTP address; None for other texts."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        return None
    scheme, host = parts.scheme.lower(), parts.hostname
    if scheme not in _PORTS or not host:
        return None
    return scheme, host.rstrip("."), port or _PORTS[scheme]
