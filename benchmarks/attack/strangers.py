"""Family of attacks: requests of web pages elsewhere, and for other hosts; one client's greed."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import requests

from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import PATIENCE, Target

_RUNAWAY = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }"
_PATHS = ("sparql?query=ASK%20%7B%7D", "dump.nq", "graphs/map", "health", "changes?since=0", "")
_HOSTS = ("evil.example", "[::1]evil", "127.0.0.1.evil.example", "localhost@evil.example", "[")
GREEDY = 60  # runaway queries of one client at once
MODERATE = 20  # queries of another meanwhile


def attack(target: Target) -> Outcome:
    """An answer to a stranger is an escape; a refusal of a moderate client is a hang."""
    total = Outcome()
    for path, headers in _requests():
        reply = _get(target, path, headers)
        escaped = reply is not None and reply.status_code < 400
        total += Outcome(1, int(escaped), target.crashed())
    return total + _greed(target)


def _requests() -> Iterator[tuple[str, dict[str, str]]]:
    for path in _PATHS:
        for host in _HOSTS:
            yield path, {"Host": host}
        for site in ("cross-site", "same-site"):
            yield path, {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors"}
            yield path, {"Sec-Fetch-Site": site, "Origin": "https://evil.example"}


def _greed(target: Target) -> Outcome:
    threads = [threading.Thread(target=target.query, args=(_RUNAWAY,)) for _ in range(GREEDY)]
    for thread in threads:
        thread.start()
    replies = [_get(target, _PATHS[0], {}) for _ in range(MODERATE)]
    hangs = sum(reply is None or reply.status_code != 200 for reply in replies)
    for thread in threads:
        thread.join()
    return Outcome(GREEDY, 0, target.crashed(), hangs + target.hangs(), target.lost())


def _get(target: Target, path: str, headers: dict[str, str]) -> requests.Response | None:
    try:
        return requests.get(target.url + path, headers=headers, timeout=PATIENCE)
    except requests.RequestException:
        return None
