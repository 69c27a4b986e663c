"""One client's excess is its own trouble, and nobody waits for what others wrote."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import requests

from kg.serving.server import BearerTokens, Limits

if TYPE_CHECKING:
    from conftest import Served

GREEDY, WRITER = "a-greedy-clients-token", "a-token-of-the-tests-0123"
TOKENS = BearerTokens((("greedy", GREEDY.encode()), ("ann", WRITER.encode())))
RUNAWAY = "SELECT (COUNT(*) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i. ?j ?k ?l}"


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def run_away(served: Served, answers: list[requests.Response]) -> None:
    answers.append(served.get("sparql", params={"query": RUNAWAY}, headers=bearer(GREEDY)))


def test_a_client_with_many_runaway_queries_is_alone_refused(serve: Callable[..., Served]) -> None:
    served = serve(tokens=TOKENS, limits=Limits(query_seconds=1.5))
    runaways: list[requests.Response] = []
    threads = [threading.Thread(target=run_away, args=(served, runaways)) for _ in range(60)]
    for thread in threads:
        thread.start()
    while not runaways:  # until the first refusals: all workers and places of this client are taken
        threads[0].join(0.05)
    others = [served.get("sparql", params={"query": "ASK {}"}) for _ in range(25)]
    assert {answer.status_code for answer in others} == {200}
    for thread in threads:
        thread.join()
    refused = [answer for answer in runaways if answer.status_code == 503]
    assert {answer.status_code for answer in runaways} == {503, 504}
    assert len(refused) >= 60 - 2 - 32
    assert all(int(answer.headers["Retry-After"]) > 0 for answer in refused)


def test_only_who_wrote_is_answered_from_what_it_wrote(serve: Callable[..., Served]) -> None:
    served = serve(tokens=TOKENS, limits=Limits(staleness=3600.0))

    def sequence(**headers: str) -> int:
        url = served.url + "sparql"
        answer = requests.get(url, {"query": "ASK {}"}, headers=headers, timeout=60)
        return int(answer.headers["Here-Sequence"])

    before = sequence()
    written = served.write("INSERT DATA { <object/1> rdfs:comment 'written just now' }")
    now = int(written.headers["Here-Sequence"])
    assert now > before
    assert sequence() == before
    assert sequence(**bearer(WRITER)) == now
    assert sequence(**{"Here-Sequence": str(now)}) == now


def test_a_client_is_never_answered_from_an_older_state_than_before(serve):
    served = serve(tokens=TOKENS, limits=Limits(staleness=0.3))
    url, seen = served.url + "sparql", []
    for number in range(40):
        served.move(1, 1.0 + number / 100)
        answer = requests.get(url, {"query": "ASK {}"}, timeout=60)
        seen.append(int(answer.headers["Here-Sequence"]))
    assert seen == sorted(seen)


def test_subscriptions_of_one_client_leave_room_for_those_of_others(serve):
    served = serve(tokens=TOKENS, limits=Limits(standing_queries=4, client_standing_queries=2))
    query = {"query": "ASK { ?s here:x ?x }"}
    mine = bearer(GREEDY)
    with (
        served.stream("subscribe", dict(query), **mine),
        served.stream("subscribe", dict(query), **mine),
    ):
        refused = served.get("subscribe", params=query, headers=mine)
        assert refused.status_code == 503
        assert int(refused.headers["Retry-After"]) > 0
        with served.stream("subscribe", dict(query)) as other:
            assert other.next()[1] == "result"


def test_feeds_of_one_client_leave_room_for_those_of_others(serve: Callable[..., Served]) -> None:
    served = serve(tokens=TOKENS, limits=Limits(feed_clients=4, client_feeds=1))
    with served.stream("changes", **bearer(GREEDY)):
        assert served.get("changes", headers=bearer(GREEDY), stream=True).status_code == 503
        with served.stream("changes", {"since": 0}) as other:
            assert other.next()[1] == "change"
