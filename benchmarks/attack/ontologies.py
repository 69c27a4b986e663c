"""Family of attacks: ontologies whose closure, depth or size is large, by every way into a map."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Iterator
from typing import Final

from benchmarks.attack.commands import outcome_of
from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import Target
from kg.model import vocabulary as v

ATTEMPTS: Final = 12
MAX_CLASSES: Final = 3000
_PREFIXES: Final = (
    f"@prefix : <{v.HERE}> . @prefix owl: <http://www.w3.org/2002/07/owl#> . "
    "@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> . "
    "@prefix skos: <http://www.w3.org/2004/02/skos/core#> .\n"
)
Edges = Iterator[tuple[int, int]]


def attack(target: Target) -> Outcome:
    """Documents drawn from the seed, each by one way; a restart after some of them."""
    total = Outcome()
    own = _own_ontology(target)
    for _ in range(ATTEMPTS):
        text = own + document(target.rng)
        total += target.rng.choice((_put, _post, _update, _file))(target, text)
        if target.rng.random() < 0.3:
            total += Outcome(0, crashes=target.restarted())
    return total + Outcome(0, crashes=target.restarted(), lost=target.lost())


def document(rng: random.Random) -> str:
    """Turtle of some thousand classes in one shape, hung below or above a class of the map."""
    count, shape = rng.randint(50, MAX_CLASSES), rng.choice(SHAPES)
    term = rng.choice(("X", "Ünit", "a", "Attack-"))
    word = rng.choice(("rdfs:subClassOf", "rdfs:subClassOf", "owl:equivalentClass"))
    lines = [f":{term}{a} {word} :{term}{b} ." for a, b in shape(rng, count)]
    lines += [f":{term}{k} a owl:Class ; rdfs:label '{term} {k}'@en ." for k in range(count)]
    lines += _labels(rng, term)
    above, below = rng.choice((("Chair", f"{term}0"), (f"{term}{count - 1}", "Furniture")))
    lines.append(f":{above} rdfs:subClassOf :{below} .")
    rng.shuffle(lines)
    return _PREFIXES + "\n".join(lines)


def _cycle(rng: random.Random, count: int) -> Edges:
    step = rng.choice((1, 1, 7))
    yield from ((k, (k + step) % count) for k in range(count))


def _chain(rng: random.Random, count: int) -> Edges:
    yield from ((k, k + 1) for k in range(count - 1))


def _diamonds(rng: random.Random, count: int) -> Edges:
    """Layers, each class of one under all (or some) of the next."""
    width = rng.randint(2, 30)
    for k in range(count - width):
        start = (k // width + 1) * width
        yield from ((k, other) for other in range(start, min(start + width, count)))


def _tangle(rng: random.Random, count: int) -> Edges:
    yield from ((rng.randrange(count), rng.randrange(count)) for _ in range(4 * count))


def _star(rng: random.Random, count: int) -> Edges:
    """One class under all others, and all others under one."""
    for k in range(1, count - 1):
        yield 0, k
        yield k, count - 1


SHAPES: Final[tuple[Callable[[random.Random, int], Edges], ...]] = (
    _cycle,
    _chain,
    _diamonds,
    _tangle,
    _star,
)


def _labels(rng: random.Random, term: str) -> list[str]:
    kind = rng.randrange(4)
    if kind == 0:
        return [f":{term}0 rdfs:label 'label {k}'@x-{k % 9} ." for k in range(4000)]
    if kind == 1:
        return [f":{term}1 skos:altLabel '{'long ' * 20_000}' ."]
    if kind == 2:
        return [f":{term}0 a [ a owl:Class ; owl:unionOf ({' '.join([f':{term}1'] * 2000)}) ] ."]
    return []


def _put(target: Target, text: str) -> Outcome:
    return _sent(target, "PUT", text)


def _post(target: Target, text: str) -> Outcome:
    return _sent(target, "POST", text)


def _sent(target: Target, method: str, text: str) -> Outcome:
    headers = {"Content-Type": "text/turtle"}
    return _beside(target, method, "graphs/ontology", data=text.encode(), headers=headers)


def _update(target: Target, text: str) -> Outcome:
    body = text.split(_PREFIXES)[1]
    prefixes = _PREFIXES.replace("@prefix", "PREFIX").replace(" . ", " ").replace(" .\n", "\n")
    update = f"{prefixes} INSERT DATA {{ GRAPH {v.ONTOLOGY_GRAPH} {{ {body} }} }}"
    return _beside(target, "POST", "sparql", data={"update": update})


def _file(target: Target, text: str) -> Outcome:
    folder = target.folder / "ontologies"
    folder.mkdir(exist_ok=True)
    (folder / "attack.ttl").write_text(text, encoding="utf-8")
    return outcome_of(["ontology", "check", str(folder / "attack.ttl")])


def _beside(target: Target, method: str, path: str, **given: object) -> Outcome:
    """A request, and a bystander beside it and after it."""
    replies = []

    def send() -> None:
        replies.append(target.request(method, path, **given))

    thread = threading.Thread(target=send)
    thread.start()
    hangs = target.hangs()
    thread.join()
    hangs += target.hangs()
    shown = target.shown(*replies)
    return Outcome(1, 0, target.crashed(), hangs, target.lost(), target.greedy(), shown)


def _own_ontology(target: Target) -> str:
    reply = target.request("GET", "graphs/ontology", headers={"Accept": "text/turtle"})
    assert reply is not None
    return reply.text + "\n"
