"""Rate limit: token buckets of addresses, refilled with time."""

from __future__ import annotations

import pytest

from kg.serving.server.http.limits import rate_limit
from kg.serving.server.http.limits.rate_limit import RateLimiter


class Clock:
    """A clock that a test sets [s]."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_burst_is_granted_and_then_one_request_for_each_refill() -> None:
    clock = Clock()
    limiter = RateLimiter(0.25, 2, clock)
    assert [limiter.take("a") for _ in range(4)] == [0, 0, 4, 4]
    assert limiter.take("b") == 0  # each address has a bucket of its own
    clock.now += 3
    assert limiter.take("a") == 1
    clock.now += 1
    assert [limiter.take("a"), limiter.take("a")] == [0, 4]
    clock.now += 1000  # a bucket holds no more than a burst
    assert [limiter.take("a") for _ in range(3)] == [0, 0, 4]


def test_the_address_that_was_silent_longest_is_forgotten_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rate_limit, "MAX_ADDRESSES", 2)
    limiter = RateLimiter(0.1, 1, Clock())
    assert [limiter.take(address) for address in ("a", "b", "a", "c")] == [0, 0, 10, 0]
    assert [limiter.take("c"), limiter.take("a")] == [10, 10]  # both are remembered
    assert limiter.take("b") == 0
