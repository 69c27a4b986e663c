"""Rate limiting by token buckets, with a replaceable clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

#: ConceptNet's rate limits: (requests, seconds).
ALLOWED: Final = ((120, 60.0), (3600, 3600.0))


@dataclass(slots=True)
class _Bucket:
    size: float
    seconds: float  # in which an empty bucket fills
    tokens: float
    filled: float  # when the tokens were last counted

    def wait(self, now: float) -> float:
        """Seconds until there is a token."""
        gained = max(0.0, now - self.filled) * self.size / self.seconds
        self.tokens, self.filled = min(self.size, self.tokens + gained), now
        return max(0.0, (1 - self.tokens) * self.seconds / self.size)


@dataclass(slots=True)
class Throttle:
    """Token-bucket rate limiter that waits before a request exceeds the limit.

    A bucket starts with half its tokens and fills over its period, so that no period of that length
    has more requests than allowed.
    """

    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    allowed: tuple[tuple[int, float], ...] = ALLOWED
    _buckets: list[_Bucket] = field(init=False)

    def __post_init__(self) -> None:
        now = self.clock()
        # half the tokens at once and half over the period: together what is allowed
        self._buckets = [
            _Bucket(max(1.0, n / 2), seconds, max(1.0, n / 2), now) for n, seconds in self.allowed
        ]

    def take(self) -> None:
        """Wait until a request is allowed, and count it."""
        while (wait := max(bucket.wait(self.clock()) for bucket in self._buckets)) > 1e-9:
            self.sleep(wait)
        for bucket in self._buckets:
            bucket.tokens -= 1
