"""Family of attacks: text that would reach the network, by every way into the server."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

from benchmarks.attack.listener import Listener
from benchmarks.attack.outcome import Outcome
from benchmarks.attack.spellings import documents, fuzzed, queries, updates
from benchmarks.attack.target import Target

_FUZZED = 200


def attack(target: Target) -> Outcome:
    """Spellings and mutations of them, as queries, queries of the past, updates and uploads."""
    with Listener() as listener:
        attempts, quoted = 0, 0
        for attempt in _attempts(target, listener.address):
            reply = attempt()
            attempts += 1
            quoted += bool(reply is not None and Listener.SECRET in getattr(reply, "text", ""))
        crashes = target.crashed()
        return Outcome(
            attempts, listener.arrived() + quoted, crashes, target.hangs(), target.lost()
        )


def _attempts(target: Target, address: str) -> Iterator[Callable[[], object]]:
    asked, written = queries(address), updates(address)
    for text in [*asked, *fuzzed(asked, _FUZZED)]:
        yield lambda text=text: target.query(text)
    for text in asked[::10]:
        yield lambda text=text: target.query(text, at="0")
        yield lambda text=text: _subscribe(target, text)
    for text in [*written, *fuzzed(written, _FUZZED // 4)]:
        if "DELETE WHERE" not in text:
            yield lambda text=text: target.update(text)
    for kind, body in documents(address):
        yield lambda kind=kind, body=body: target.request(
            "POST", "graphs?graph=urn:uploaded", data=body, headers={"Content-Type": kind}
        )


def _subscribe(target: Target, text: str) -> None:
    reply = target.request("GET", "subscribe", params={"query": text}, stream=True)
    if reply is not None:
        # the stream of what is no attack would not end
        threading.Timer(0.01, reply.close).start()
