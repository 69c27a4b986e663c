"""Moments in requests: ISO 8601, or the number of a transaction."""

from __future__ import annotations

import re
from functools import partial
from typing import Final

from starlette.concurrency import run_in_threadpool

from kg.history.timestamps import moment, sequence_of
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.serving.server.http.problems import Problem

MAX_DIGITS: Final = 18  # of a transaction's number


async def sequence_at(semantic_map: SemanticMap, text: str) -> int:
    """The last transaction at or before a moment: ISO 8601, or a number, 42 or #42.

    Raises Problem: 400 for an invalid moment, 404 if that past is not kept.
    """
    text = text.strip()
    if re.fullmatch(rf"#?[0-9]{{1,{MAX_DIGITS}}}", text):
        when: int | str = int(text.removeprefix("#"))
    else:
        when = text
        try:
            moment(text)
        except HistoryError as error:
            raise Problem(
                400, f"no moment {text[:60]!r}; write 42 (a transaction) or 2026-08-01T12:30:00Z"
            ) from error
    return await run_in_threadpool(partial(sequence_of, semantic_map.history.log, when))
