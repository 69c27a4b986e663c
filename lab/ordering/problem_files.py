"""Search problems in a JSON file: worlds of places, and what is sought there.

See lab/research/ordering.md.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kg.model.errors import did_you_mean
from lab.ordering.problem import OrderingError, OrderingProblem


@dataclass(frozen=True, slots=True, eq=False)
class SearchProblem:
    """One query of such a file."""

    id: str
    places: tuple[int | str, ...]  # the file's names of the problem's places
    problem: OrderingProblem
    possible: bool = True  # False: p is 0 everywhere; `problem` holds all places equally likely


@dataclass(frozen=True, slots=True, eq=False)
class _World:
    places: tuple[int | str, ...]
    explore: list[Any]
    T: Any


def read_problems(path: Path) -> list[SearchProblem]:
    """All queries of the file, in its order.

    Raises OrderingError, naming the world or query, for what is not JSON, keys that are missing,
    and numbers that make no sense.
    """
    document = _read(path)
    worlds = {}
    for number, entry in enumerate(_list(document, "worlds", str(path))):
        world = _object(entry, f"world {number}")
        worlds[_name(world, f"world {number}")] = _world(world, f"world {number}")
    problems: dict[str, SearchProblem] = {}
    for number, entry in enumerate(_list(document, "queries", str(path))):
        query = _object(entry, f"query {number}")
        name = _name(query, f"query {number}")
        if name in problems:
            raise OrderingError(f"{path}: two queries are called {name!r}; ids must differ")
        problems[name] = _problem(query, name, worlds)
    return list(problems.values())


def _read(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OrderingError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise OrderingError(f"{path} is not JSON: {error}") from error
    return _object(document, str(path))


def _world(world: dict[str, Any], where: str) -> _World:
    places = [_object(place, f"{where}: a place") for place in _list(world, "places", where)]
    names = tuple(_get(place, "id", f"{where}: a place") for place in places)
    if any(isinstance(name, bool) or not isinstance(name, int | str) for name in names):
        raise OrderingError(f"{where}: ids of places must be numbers or names, got {names[:5]}")
    if len(set(names)) < len(names):
        raise OrderingError(f"{where}: two places have the same id; ids must differ")
    explore = [_get(place, "explore_s", f"{where}: place {place['id']}") for place in places]
    return _World(names, explore, np.asarray(_table(_get(world, "T", where), where)))


def _table(rows: object, where: str) -> Any:
    try:
        return np.asarray(rows)
    except ValueError:
        raise OrderingError(f"{where}: T must be numbers in rows of equal length") from None


def _problem(query: dict[str, Any], name: str, worlds: dict[str, _World]) -> SearchProblem:
    where = f"query {name!r}"
    world_name = _get(query, "world", where)
    if not isinstance(world_name, str) or world_name not in worlds:
        hint = did_you_mean(str(world_name), list(worlds))
        raise OrderingError(
            f"{where}: no world {world_name!r}{hint}; there are: {', '.join(worlds)}"
        )
    world = worlds[world_name]
    p, t0, model = (_get(query, key, where) for key in ("p", "t0", "model"))
    possible = not _all_zero(p)
    if not possible:
        p = [1.0 / len(p)] * len(p)
    try:
        problem = OrderingProblem(p, world.T, t0, np.asarray(world.explore), model)
    except OrderingError as error:
        raise OrderingError(f"{where}: {error}") from error
    return SearchProblem(name, world.places, problem, possible)


def _all_zero(p: object) -> bool:
    return isinstance(p, list) and bool(p) and all(isinstance(x, int | float) and x == 0 for x in p)


def _object(value: object, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise OrderingError(f"{where} must be a JSON object, got {type(value).__name__}")
    return value


def _get(value: dict[str, Any], key: str, where: str) -> Any:
    if key not in value:
        raise OrderingError(f"{where} has no {key!r}{did_you_mean(key, list(value))}")
    return value[key]


def _list(value: dict[str, Any], key: str, where: str) -> list[Any]:
    found = _get(value, key, where)
    if not isinstance(found, list) or not found:
        raise OrderingError(f"{where}: {key!r} must be a list with something in it")
    return found


def _name(value: dict[str, Any], where: str) -> str:
    name = _get(value, "id", where)
    if not isinstance(name, str):
        raise OrderingError(f"{where}: 'id' must be a text, got {name!r}")
    return name
