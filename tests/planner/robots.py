"""A small map to search, and robots to search it with, for the tests of the executive."""

import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from planner.execution.options import Event, SearchOptions, SearchOutcome
from planner.execution.search_loop import search
from planner.execution.transports.line_transport import ChildRobot

SCRIPT = Path(__file__).with_name("point_robot.py")
START = 1_772_442_000.0
APPLE = ["apple", 6.0, 2.0, 0.8, 0.9]  # in the kitchen
FAR_APPLE = ["apple", 2.0, 6.0, 0.8, 0.9]  # in the bedroom


def ring(semantic_map: SemanticMap, apples: int = 0, rooms: int = 3) -> None:
    """Three rooms, each next to both others, and perhaps apples that are remembered in one.

    Or the first two of these `rooms`, with one door between them.
    """
    iri = semantic_map.catalogue.find
    plan = [
        ("corridor", 0.0, 4.0, 0.0, 4.0),
        ("kitchen", 4.0, 8.0, 0.0, 4.0),
        ("bedroom", 0.0, 8.0, 4.0, 8.0),
    ]
    places = [
        PlaceRecord(
            semantic_map.place_iri(n), f"place {n}", *edges, 6, {iri(name, "place").iri: 0.9}
        )
        for n, (name, *edges) in enumerate(plan[:rooms], start=1)
    ]
    objects = [
        ObjectRecord(
            iri=semantic_map.new_object_iri(),
            category=iri("apple").iri,
            p_map=np.array([5.0 + n, 3.0, 0.8]),
            confidence=2.4,
            existence=0.8,
            observations=5,
            first_seen=START - 60,
            last_seen=START,
            place=semantic_map.place_iri(2),
        )
        for n in range(apples)
    ]
    semantic_map.apply(MapUpdate(objects=tuple(objects), places=tuple(places)))


def command(**settings: Any) -> str:
    """The command line of a point robot."""
    return shlex.join([sys.executable, str(SCRIPT), json.dumps(settings)])


def run(
    semantic_map: SemanticMap,
    *words: str,
    resume: bool = False,
    timeout: float = 120.0,
    budget: float | None = None,
    later: float = 60.0,
    give_up_at: float = 0.05,
    on_event: Callable[[Event], None] = lambda event: None,
    **settings: Any,
) -> SearchOutcome:
    """Search with a point robot in a process of its own."""
    options = SearchOptions(
        budget=budget,
        give_up_at=give_up_at,
        timeout=timeout,
        on_event=on_event,
        clock=lambda: START + later,
    )
    return search(semantic_map, words, ChildRobot(command(**settings)), options, resume=resume)
