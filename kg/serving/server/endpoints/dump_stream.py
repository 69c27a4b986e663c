"""Dump as an HTTP response: streamed in chunks as a worker writes it."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from kg.model.errors import HereaboutsError
from kg.serving.server.http.problems import problem_of, problem_response
from kg.serving.workers.dumps import Dump

log = logging.getLogger("hereabouts.server")


class DumpStream:
    """ASGI response that sends a dump and then closes it.

    A failure before the first part is a problem response. A later one aborts the connection, so
    that a client does not take a part of the map for the whole.
    """

    def __init__(self, dump: Dump, headers: Mapping[str, str]) -> None:
        self._dump, self._headers = dump, headers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        begun = False
        try:
            part = await run_in_threadpool(self._dump.read)
            raw = [(k.lower().encode(), v.encode()) for k, v in self._headers.items()]
            await send({"type": "http.response.start", "status": 200, "headers": raw})
            begun = True
            while part:
                await send({"type": "http.response.body", "body": part, "more_body": True})
                part = await run_in_threadpool(self._dump.read)
            await send({"type": "http.response.body", "body": b""})
        except HereaboutsError as error:
            if begun:
                log.error("a dump broke off: %s", error)
                scope["state"]["connection"].abort()
            else:
                await problem_response(problem_of(error), None)(scope, receive, send)
        finally:
            await run_in_threadpool(self._dump.close)
