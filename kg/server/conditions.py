"""Conditional requests (RFC 9110, section 13): a client that has what it asks for is told so."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import format_datetime, parsedate_to_datetime

from starlette.requests import Request

from kg.errors import HistoryError
from kg.semantic_map import SemanticMap


@dataclass(frozen=True, slots=True)
class State:
    """Which state of the map an answer is about."""

    sequence: int
    modified: int | None  # [s] since 1970, from which on nothing had changed; None: not told

    @property
    def tag(self) -> str:
        """Its entity tag; weak, for an answer in another format has the same."""
        return f'W/"{self.sequence}"'

    @property
    def headers(self) -> dict[str, str]:
        """What the answer says of it."""
        told = {"ETag": self.tag, "Cache-Control": "no-cache"}
        if self.modified is not None:
            moment = datetime.fromtimestamp(self.modified, UTC)
            told["Last-Modified"] = format_datetime(moment, usegmt=True)
        return told

    def is_known_to(self, request: Request) -> bool:
        """Whether the client has this state already; tags outrank dates."""
        tags = request.headers.get("if-none-match")
        if tags is not None:
            given = {tag.strip().removeprefix("W/") for tag in tags.split(",")}
            return "*" in given or self.tag.removeprefix("W/") in given
        since = _moment(request.headers.get("if-modified-since"))
        return since is not None and self.modified is not None and self.modified <= since


def state_of(semantic_map: SemanticMap) -> State:
    """The state the map is in now.

    HTTP dates are whole seconds. A commit counts as of the second after it, and while that is still
    to come there is no date: so no second commit of the same second goes unnoticed.
    """
    sequence = semantic_map.sequence
    try:
        last = semantic_map.history.last_time
    except HistoryError:
        return State(sequence, None)
    modified = math.floor(last) + 1
    return State(sequence, modified if last > 0 and modified <= time.time() else None)


def _moment(text: str | None) -> float | None:
    try:
        return parsedate_to_datetime(text).timestamp() if text else None
    except (ValueError, OverflowError):
        return None
