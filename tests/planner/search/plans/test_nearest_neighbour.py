"""Nearest-neighbour order: the nearest of what remains, from where the robot is by then."""

from __future__ import annotations

from planner.search.plans.orders import nearest_neighbour


def test_the_nearest_is_chosen_anew_after_each_item() -> None:
    def metres(here: int | None, item: int) -> float:
        return abs(item - (0 if here is None else here))

    assert list(nearest_neighbour([-2, 1, 3], metres)) == [1, 3, -2]


def test_of_items_equally_near_the_first_given_comes_first() -> None:
    assert list(nearest_neighbour("bca", lambda here, item: 0.0)) == ["b", "c", "a"]


def test_distances_may_depend_on_what_happens_between_the_items() -> None:
    at = [0.0]
    order = []
    for item in nearest_neighbour([1.0, 4.0, 9.0], lambda _, item: abs(item - at[0])):
        order.append(item)
        at[0] = 10.0
    assert order == [1.0, 9.0, 4.0]
