"""Family of attacks: writes that others wait for, by size, by shape and by numbers."""

from __future__ import annotations

import random
import string
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

import requests

from benchmarks.attack.exhaustion import GRACE
from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import ROBOT, SECONDS, Target
from kg.model import vocabulary as v

ATTEMPTS: Final = 16
WAIT: Final = 3.5  # [s] of another's write: two with the lock of the map, the rest its own work
_PREFIXES: Final = f"@prefix : <{v.HERE}> .\n"
_FINE: Final = (200, 201, 204)
_REFUSED: Final = (400, 409, 413, 422, 428, 503, 504)


def attack(target: Target) -> Outcome:
    """Documents drawn from the seed, each by one way, and another who writes beside it."""
    total = Outcome()
    for _ in range(ATTEMPTS):
        total += _beside(target, target.rng.choice((_post, _put, _update, _delete)))
    for act in (_numbers, _labels, _terminated):
        total += act(target)
    return total + Outcome(0, lost=target.lost())


def document(rng: random.Random) -> str:
    """Turtle of hundreds to tens of thousands of facts in one shape."""
    name = "".join(rng.choices(string.ascii_letters, k=6))
    return _PREFIXES + "".join(rng.choice(SHAPES)(rng.choice((300, 3000, 30_000)), name))


def _subjects(count: int, name: str) -> Iterator[str]:
    return (f"<urn:{name}:{i}> <urn:{name}> {i} .\n" for i in range(count))


def _one_subject(count: int, name: str) -> Iterator[str]:
    return (f"<urn:{name}> <urn:{name}> {i} .\n" for i in range(count))


def _properties(count: int, name: str) -> Iterator[str]:
    return (f"<urn:{name}> <urn:{name}:{i}> 1 .\n" for i in range(count))


def _hub(count: int, name: str) -> Iterator[str]:
    return (f"<urn:{name}:{i}> <urn:{name}> <urn:{name}> .\n" for i in range(count))


def _cups(count: int, name: str) -> Iterator[str]:
    return (f"<urn:{name}:{i}> a :Cup ; :x {i % 9}.5 ; :y 1.0 .\n" for i in range(count))


def _stacked(count: int, name: str) -> Iterator[str]:
    return (
        f"<urn:{name}:{i}> a :Cup ; :x 1.0 ; :y 1.0 ; :on <urn:{name}:{i + 1}> .\n"
        for i in range(count)
    )


def _places(count: int, name: str) -> Iterator[str]:
    return (
        f"<urn:{name}:{i}> a :Place ; :xMin 0.0 ; :xMax 1.0 ; :yMin 0.0 ; :yMax 1.0 .\n"
        for i in range(count)
    )


def _blanks(count: int, name: str) -> Iterator[str]:
    return (f"[] <urn:{name}> [ <urn:{name}> {i} ] .\n" for i in range(count))


def _list(count: int, name: str) -> Iterator[str]:
    yield f"<urn:{name}> <urn:{name}> ("
    yield from (f" {i}" for i in range(count))
    yield " ) .\n"


SHAPES: Final[tuple[Callable[[int, str], Iterator[str]], ...]] = (
    *(_subjects, _one_subject, _properties, _hub, _cups, _stacked, _places, _blanks, _list),
)


def _post(target: Target) -> requests.Response | None:
    return _document(target, "POST", "graphs/map")


def _put(target: Target) -> requests.Response | None:
    return _document(target, "PUT", f"graphs?graph=urn:{target.rng.choice('abc')}")


def _update(target: Target) -> requests.Response | None:
    count = target.rng.choice((100, 3000))
    facts = "".join(SHAPES[target.rng.randrange(4)](count, "u"))
    return target.update(f"INSERT DATA {{ {facts} }}")


def _delete(target: Target) -> requests.Response | None:
    ours = "?s ?p ?o FILTER(STRSTARTS(STR(?s), 'urn:'))"
    return target.update(f"DELETE {{ ?s ?p ?o }} WHERE {{ {ours} }}")


def _document(target: Target, method: str, path: str) -> requests.Response | None:
    kind = {"Content-Type": "text/turtle", "Here-Confirm": "delete"}
    return target.request(method, path, data=document(target.rng).encode(), headers=kind)


def _beside(target: Target, act: Callable[[Target], requests.Response | None]) -> Outcome:
    replies: list[requests.Response | None] = []
    thread = threading.Thread(target=lambda: replies.append(act(target)))
    thread.start()
    slowest, refused = 0.0, False
    while thread.is_alive():
        began = time.monotonic()
        headers = {"Authorization": f"Bearer {ROBOT}"}
        mark = {"update": f"INSERT DATA {{ <urn:beside> <urn:at> {began} }}"}
        reply = target.request("POST", "sparql", data=mark, headers=headers)
        refused |= reply is None or reply.status_code not in _FINE
        slowest = max(slowest, time.monotonic() - began)
        time.sleep(0.05)
    thread.join()
    hangs = int(slowest > WAIT or refused or not _is_clear(*replies))
    return Outcome(1, 0, target.crashed(), hangs, target.lost(), 0, target.shown(*replies))


def _is_clear(*replies: requests.Response | None) -> bool:
    """Whether each reply is a success, or a refusal that names the reason."""
    return all(
        reply is not None and (reply.status_code in _FINE or reply.status_code in _REFUSED)
        for reply in replies
    )


def _numbers(target: Target) -> Outcome:
    """Numbers of things that no machine word holds, at each door that reads IRIs."""
    digits = target.rng.choice("123456789") * target.rng.choice((19, 400, 5000))
    replies = [
        target.update(f"INSERT DATA {{ <object/{digits}> a here:Cup ; here:x 1.0 ; here:y 1.0 }}"),
        target.update(f"INSERT DATA {{ <place/{digits}> rdfs:label 'x' }}"),
        target.query(f"SELECT * {{ <object/{digits}> ?p ?o }}"),
        target.query(f"SELECT ({digits} + 1 AS ?n) {{}}"),
        target.request("GET", f"object/{digits}"),
        target.request("GET", f"place/{digits}"),
        target.request("GET", f"pictures/{digits}"),
        target.request("GET", f"log?last={digits}"),
        target.request("GET", f"state?at=%23{digits}"),
        target.request("GET", f"changes?since={digits}", headers={"Accept": "application/json"}),
        target.request("GET", "sparql?query=ASK{}", headers={"Here-Sequence": digits}),
        target.request("DELETE", f"assertions?iri=object/{digits}&property=label"),
    ]
    failed = sum(reply is None or reply.status_code == 500 for reply in replies)
    return Outcome(len(replies), 0, target.crashed(), failed, 0, 0, target.shown(*replies))


def _labels(target: Target) -> Outcome:
    """Labels of networks grow the ontology until it is full; it can still be put back."""
    for count in (500, 5000, 9999):
        name = "".join(target.rng.choices(string.ascii_lowercase, k=5))
        labels = [f"{name}{i}" for i in range(count)]
        target.request("POST", "labels", json={"labels": labels, "kind": "object", "model": "m"})
    own = target.request("GET", "graphs/ontology", headers={"Accept": "text/turtle"})
    assert own is not None
    kind = {"Content-Type": "text/turtle"}
    back = target.request("PUT", "graphs/ontology", data=own.content, headers=kind, timeout=120)
    is_back = back is not None and back.status_code in _FINE
    return Outcome(1, 0, target.crashed(), int(not is_back), target.lost())


def _terminated(target: Target) -> Outcome:
    """SIGTERM while a large document is validated."""
    thread = threading.Thread(target=_post, args=(target,))
    thread.start()
    thread.join(SECONDS / 4)
    ended = target.ends_when_told(GRACE)
    thread.join()
    return Outcome(1, 0, target.crashed(), int(not ended), target.lost())
