"""Shares of clients in what the server holds; where there is too much, the greediest loses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar


class Held(Protocol):
    """Something that is held for a client."""

    client_name: str


T = TypeVar("T", bound=Held)


def greediest(held: Iterable[T], amount: Callable[[T], int]) -> list[T]:
    """What is held for the client with the largest total `amount`; empty if nothing is held."""
    held = tuple(held)
    totals: Counter[str] = Counter()
    for one in held:
        totals[one.client_name] += amount(one)
    names = [name for name, _ in totals.most_common(1)]
    return [one for one in held if one.client_name in names]
