"""Cache of what pages draw: one compressed answer for each moment, made once for all clients.

At most one is made at a time. A request whose client has left gives up its turn, so that somebody
who drags through a year costs one answer at a time, and only of moments that are still asked for.
"""

from __future__ import annotations

import asyncio
import gzip
import secrets
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Final

from starlette.concurrency import run_in_threadpool

from kg.serving.workers.process import Answer

MAX_BYTES: Final = 32 << 20  # of all answers; the last one is always kept
MAX_WAITING: Final = 64  # requests
_LEVEL: Final = 6

#: number of a transaction, whether it is shown as the past, and which answer it is
Key = tuple[int, bool, *tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class StoredAnswer:
    """An answer under gzip, and the number of its transaction."""

    sequence: int
    packed: bytes


@dataclass(slots=True)
class StateCache:
    """The last states that were asked for; used on one event loop."""

    answers: OrderedDict[Key, StoredAnswer] = field(default_factory=OrderedDict)
    waiting: int = 0  # requests
    mark: str = field(default_factory=lambda: secrets.token_hex(4))  # of this server, in tags
    _turn: asyncio.Lock = field(default_factory=asyncio.Lock)

    async def get(self, key: Key, make: Callable[[], Awaitable[Answer]]) -> StoredAnswer:
        """The answer of that key; `make` makes it if it is not in the cache.

        It is completed even if the request is cancelled meanwhile.
        """
        if key not in self.answers:
            self.waiting += 1
            try:
                await self._turn.acquire()
            finally:
                self.waiting -= 1
            making = asyncio.ensure_future(self._made(key, make))
            making.add_done_callback(self._end)
            await asyncio.shield(making)
        self.answers.move_to_end(key)
        return self.answers[key]

    async def _made(self, key: Key, make: Callable[[], Awaitable[Answer]]) -> None:
        if key in self.answers:  # another request has made it meanwhile
            return
        answer = await make()
        packed = await run_in_threadpool(gzip.compress, answer.body, _LEVEL, mtime=0)
        self.answers[key] = StoredAnswer(answer.sequence, packed)
        while len(self.answers) > 1 and self._size() > MAX_BYTES:
            self.answers.popitem(last=False)

    def _end(self, making: asyncio.Future[None]) -> None:
        self._turn.release()
        if not making.cancelled():
            making.exception()  # marks the exception as read: the client may have left

    def _size(self) -> int:
        return sum(len(one.packed) for one in self.answers.values())
