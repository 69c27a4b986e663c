"""Fair queueing: who gets a worker, who waits, who is refused."""

from concurrent.futures import CancelledError
from contextlib import suppress

import pytest

from kg.model.errors import GraphError, PoolBusyError
from kg.serving.workers.admission import FairQueue, Turn


def granted(*turns: Turn) -> list[bool]:
    return [turn.granted.done() for turn in turns]


def test_a_client_has_at_most_all_workers_but_one() -> None:
    fair = FairQueue(3, 10)
    assert granted(*[fair.enter("greedy", "present") for _ in range(5)]) == [True, True] + 3 * [
        False
    ]
    assert granted(fair.enter("other", "present")) == [True]


def test_the_client_that_waits_for_too_much_is_refused_and_nobody_else() -> None:
    fair = FairQueue(3, 4)
    for _ in range(6):
        fair.enter("greedy", "present")
    with pytest.raises(PoolBusyError, match="4 queries of yours wait"):
        fair.enter("greedy", "present")
    for client in "abcdefgh":
        fair.enter(client, "present")


def test_a_crowd_of_greedy_clients_leaves_a_place_for_each_newcomer() -> None:
    fair, turns = FairQueue(3, 4), []
    for client in range(100):
        for _ in range(6):
            with suppress(PoolBusyError):
                turns.append(fair.enter(f"greedy {client}", "present"))
    assert not fair.enter("newcomer", "present").granted.done()
    assert granted(*turns).count(False) <= 200


def test_clients_take_turns_however_many_queries_one_has_waiting() -> None:
    fair = FairQueue(1, 10)
    running = fair.enter("greedy", "present")
    greedy = [fair.enter("greedy", "present") for _ in range(5)]
    other = [fair.enter("other", "present") for _ in range(2)]
    order = []
    for _ in range(7):
        fair.leave(running)
        (running,) = (t for t in (*greedy, *other) if t.granted.done() and t not in order)
        order.append(running)
    assert [turn.client for turn in order[:4]] in (
        ["greedy", "other", "greedy", "other"],
        ["other", "greedy", "other", "greedy"],
    )


def test_questions_about_the_past_never_take_the_last_worker() -> None:
    fair = FairQueue(2, 10)
    past = [fair.enter(client, "past") for client in "ab"]
    assert granted(*past) == [True, False]
    assert granted(fair.enter("a", "present")) == [True]


def test_standing_queries_run_one_at_a_time_and_behind_the_others() -> None:
    fair = FairQueue(3, 10)
    first, second = fair.enter("a", "standing"), fair.enter("b", "standing")
    interactive = [fair.enter("c", "present") for _ in range(2)]
    assert granted(first, second, *interactive) == [True, False, True, False]
    fair.leave(first)
    assert granted(second, interactive[1]) == [False, True]
    fair.leave(interactive[0])
    assert granted(second) == [True]


def test_who_gives_up_makes_room_whether_it_waited_or_ran() -> None:
    fair = FairQueue(1, 1)
    ran, waited = fair.enter("a", "present"), fair.enter("a", "present")
    fair.leave(waited)
    third = fair.enter("a", "present")
    third.granted.cancel()
    fair.leave(ran)
    with pytest.raises(CancelledError):
        third.granted.result()
    assert granted(fair.enter("b", "present")) == [True]


def test_closing_ends_those_that_wait() -> None:
    fair = FairQueue(1, 5)
    fair.enter("a", "present")
    waiting = fair.enter("a", "present")
    fair.close()
    with pytest.raises(GraphError, match="closed"):
        waiting.granted.result()
    with pytest.raises(GraphError, match="closed"):
        fair.enter("a", "present")


def test_questions_about_the_past_take_half_of_a_clients_places() -> None:
    fair = FairQueue(2, 4)
    running = [fair.enter("a", "past") for _ in range(3)]  # one runs, two wait
    assert granted(*running) == [True, False, False]
    with pytest.raises(PoolBusyError, match="about the past"):
        fair.enter("a", "past")
    assert granted(fair.enter("a", "present")) == [True]
