"""`/find`: plans are made one at a time, and who asks waits for its turn."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import TYPE_CHECKING

from kg.model.errors import ModelError, UnknownCategoryError
from kg.serving.server.app_state import MAX_WAITING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from conftest import Served


def test_requests_wait_for_their_turn_and_too_many_are_refused(serve):
    at_once, most, go_on = 0, 0, threading.Event()

    def planner(wanted: list[str]) -> Mapping[str, object]:
        nonlocal at_once, most
        at_once += 1
        most = max(most, at_once)
        assert go_on.wait(60)
        at_once -= 1
        return {"target": wanted[0]}

    served = serve(planner=planner)
    with ThreadPoolExecutor(MAX_WAITING + 2) as clients:
        asked = [
            clients.submit(served.get, "find", params={"object": f"cup {number}"})
            for number in range(MAX_WAITING + 2)
        ]
        refused = next(as_completed(asked)).result()
        go_on.set()
        statuses = sorted(answer.result().status_code for answer in asked)
    assert (refused.status_code, refused.headers["Retry-After"]) == (503, "5")
    assert statuses == [*(200 for _ in range(MAX_WAITING + 1)), 503]
    assert most == 1


def test_a_plan_is_made_once_until_the_map_changes(serve: Callable[..., Served]) -> None:
    made: list[list[str]] = []

    def planner(wanted: list[str]) -> Mapping[str, object]:
        made.append(wanted)
        return {"target": wanted[0]}

    served = serve(planner=planner)
    for _ in range(3):
        assert served.get("find?object=cup&object=chair").json() == {"target": "cup"}
    served.move(1, 2.0)
    assert served.get("find?object=cup").json() == {"target": "cup"}
    assert made in ([["cup", "chair"], ["cup"]], [["cup", "chair"]] * 2 + [["cup"]])  # a new minute
    assert served.get("find?object=cup&at=1").status_code == 400


def test_a_planner_that_fails_leaves_the_turn_to_the_next(serve: Callable[..., Served]) -> None:
    def planner(wanted: list[str]) -> Mapping[str, object]:
        if wanted == ["dodo"]:
            raise UnknownCategoryError("no category 'dodo'")
        if wanted == ["чашка"]:
            raise ModelError("the text encoder does not know the words of 'чашка'")
        return {"target": wanted[0]}

    served = serve(planner=planner)
    statuses = [
        served.get("find", params={"object": o}).status_code for o in ("dodo", "чашка", "cup")
    ]
    assert statuses == [422, 422, 200]
