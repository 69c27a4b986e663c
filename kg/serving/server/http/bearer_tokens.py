"""Bearer tokens (RFC 6750) from a file, compared in constant time."""

from __future__ import annotations

import hmac
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

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
