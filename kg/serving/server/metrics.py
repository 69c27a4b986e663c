"""Metrics of the server in Prometheus' text format (version 0.0.4)."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Final

BUCKETS: Final = (0.001, 0.005, 0.01, 0.05, 0.1, 0.5, 1.0, 5.0, 10.0)  # [s]
MEDIA_TYPE: Final = "text/plain; version=0.0.4"

#: name (a counter's ends with _total), help text, function that reads the value
Reading = tuple[str, str, Callable[[], float]]


class Metrics:
    """Requests by route, method and status, latencies, and `readings` taken at each scrape."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._requests: Counter[tuple[str, str, int]] = Counter()
        self._buckets: dict[str, list[int]] = {}
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self.readings: list[Reading] = []

    def request(self, route: str, method: str, status: int, seconds: float) -> None:
        """Count one finished request."""
        with self._guard:
            self._requests[route, method, status] += 1
            buckets = self._buckets.setdefault(route, [0] * (len(BUCKETS) + 1))
            buckets[bisect_left(BUCKETS, seconds)] += 1
            self._seconds[route] += seconds

    def text(self) -> str:
        """All metrics, a line each."""
        with self._guard:
            lines = [*self._request_lines(), *self._latency_lines()]
        for name, about, read in self.readings:
            kind = "counter" if name.endswith("_total") else "gauge"
            lines += [*_head(name, kind, about), f"{name} {read()}"]
        return "\n".join(lines) + "\n"

    def _request_lines(self) -> Iterable[str]:
        yield from _head("hereabouts_http_requests_total", "counter", "Finished requests.")
        for (route, method, status), count in sorted(self._requests.items()):
            labels = f'route="{route}",method="{method}",status="{status}"'
            yield f"hereabouts_http_requests_total{{{labels}}} {count}"

    def _latency_lines(self) -> Iterable[str]:
        name = "hereabouts_http_request_seconds"
        yield from _head(name, "histogram", "Time from a request's head to the end of its answer.")
        for route, buckets in sorted(self._buckets.items()):
            total = 0
            for bound, count in zip((*map(str, BUCKETS), "+Inf"), buckets, strict=True):
                total += count
                yield f'{name}_bucket{{route="{route}",le="{bound}"}} {total}'
            yield f'{name}_sum{{route="{route}"}} {self._seconds[route]:.6f}'
            yield f'{name}_count{{route="{route}"}} {total}'


def _head(name: str, kind: str, about: str) -> tuple[str, str]:
    return f"# HELP {name} {about}", f"# TYPE {name} {kind}"
