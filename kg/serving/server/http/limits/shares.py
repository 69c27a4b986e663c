"""Shares of clients in what the server holds; where there is too much, the greediest loses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Generic, Protocol, TypeVar


class Held(Protocol):
    """Something that is held for a client."""

    client_name: str


T = TypeVar("T", bound=Held)


def greediest(held: Iterable[T], amount: Callable[[T], int]) -> list[T]:
    """The items of the client with the largest total `amount`; empty without any item."""
    held = tuple(held)
    totals: Counter[str] = Counter()
    for one in held:
        totals[one.client_name] += amount(one)
    names = [name for name, _ in totals.most_common(1)]
    return [one for one in held if one.client_name in names]


class Shares(Generic[T]):
    """The items of each client, in the order of its last activity."""

    def __init__(self) -> None:
        self._of: dict[str, dict[T, None]] = {}

    def renew(self, one: T) -> None:
        """Hold `one` for its client, as the one that was active last."""
        own = self._of.setdefault(one.client_name, {})
        own.pop(one, None)
        own[one] = None

    def remove(self, one: T) -> None:
        """Hold `one` no longer, if it was held."""
        own = self._of.get(one.client_name, {})
        own.pop(one, None)
        if not own:
            self._of.pop(one.client_name, None)

    def of_most(self) -> Iterable[T]:
        """The items of the client with the most, the longest inactive item first."""
        return max(self._of.values(), key=len, default={})
