"""Rate limit: a token bucket for each client address."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable

MAX_ADDRESSES = 4096  # remembered at once


class RateLimiter:
    """Token buckets of `burst` requests, refilled by `rate` a second, one for each address."""

    def __init__(
        self, rate: float, burst: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._rate, self._burst, self._clock = rate, burst, clock
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, address: str) -> int:
        """0 if the request is granted, else the whole seconds to wait."""
        now = self._clock()
        left, since = self._left.pop(address, (float(self._burst), now))
        left = min(left + (now - since) * self._rate, float(self._burst))
        granted = left >= 1
        self._left[address] = (left - granted, now)
        if len(self._left) > MAX_ADDRESSES:
            self._left.popitem(last=False)
        return 0 if granted else max(1, math.ceil((1 - left) / self._rate))
