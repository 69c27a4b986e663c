"""Questions asked by the tools that agents have, through the package's own client."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import datetime
from typing import Any

from anyio.from_thread import start_blocking_portal
from mcp import Client
from mcp.client.stdio import StdioServerParameters

from benchmarks.questions.graph_maps import AskedMap
from benchmarks.questions.sparql_interfaces import SEEN_IN, in_order

Answer = dict[str, Any]


class McpInterface:
    """Each family by the tools of `hereabouts mcp URL`, over stdin and stdout."""

    def __init__(self, asked: AskedMap, url: str) -> None:
        self._since = asked.since
        words = ["-m", "planner.cli", "mcp", url]
        with ExitStack() as stack:
            self._portal = stack.enter_context(start_blocking_portal())
            self._client = stack.enter_context(
                self._portal.wrap_async_context_manager(
                    Client(StdioServerParameters(command=sys.executable, args=words))
                )
            )
            self._running = stack.pop_all()

    def close(self) -> None:
        """End the process."""
        self._running.close()

    def call(self, tool: str, **arguments: Any) -> Answer:
        """The structured answer of a tool; raises RuntimeError with its error."""
        found = self._portal.call(self._client.call_tool, tool, arguments)
        if found.is_error:
            raise RuntimeError(f"{tool} {json.dumps(arguments)}: {found.content}")
        return dict(found.structured_content or {})

    def count(self, category: str) -> int:
        listed = self.call("describe_map")["categories"]
        counts = {one["untrusted_category"]: one["count"] for one in listed}
        return int(counts.get(category, 0))

    def count_in_place(self, category: str, room: str) -> int:
        return len(self._of(category, room))

    def presence(self, category: str, room: str) -> bool:
        return self.never_looked(category, room) == "present"

    def nearest(self, category: str, to: str, to_room: str) -> list[float] | None:
        near = self._around(to, to_room, 100.0)
        first = next((one for one in near or () if one["untrusted_category"] == category), None)
        return None if first is None else [first["x"], first["y"]]

    def within_radius(self, radius: float, of: str, of_room: str) -> list[str] | None:
        return _categories(self._around(of, of_room, radius))

    def between(self, one: str, one_room: str, other: str, other_room: str) -> list[str] | None:
        ends = self._one(one, one_room), self._one(other, other_room)
        if ends[0] is None or ends[1] is None:
            return None
        ends_named = {"one": ends[0]["iri"], "other": ends[1]["iri"]}
        return _categories(self.call("what_is_between", **ends_named, limit=100)["things"])

    def on_or_in(self, thing: str, thing_room: str) -> list[str] | None:
        carrier = self._one(thing, thing_room)
        if carrier is None:
            return None
        return _categories(self.call("what_is_in", what=carrier["iri"], limit=100)["things"])

    def last_seen(self, category: str) -> float | None:
        found = self.call("where_is", what=category, limit=100)
        known = [one for one in found["things"] if one["probability"] >= 0.5]
        known = [one for one in known if one["untrusted_category"] == category]
        times = [one["last_seen"] for one in (*known, *found["departed"]) if one["last_seen"]]
        return datetime.fromisoformat(max(times)).timestamp() if times else None

    def moved_since(self, room: str | None) -> list[str] | None:
        changed = self.call("what_changed", since=self._since, limit=100)["things"]
        places = {one["iri"]: one["untrusted_label"] for one in self.call("describe_map")["places"]}
        moved = [one for one in changed if one["kind"] == "moved"]
        return _categories(one for one in moved if room in (None, places.get(one["place"])))

    def never_looked(self, category: str, room: str) -> str:
        return str(self.call("status", what=category, place=room)["status"])

    def why(self, thing: str, thing_room: str) -> list[str] | None:
        one = self._one(thing, thing_room)
        if one is None:
            return None
        steps = self.call("why", what=one["iri"])["steps"]
        found = SEEN_IN.search(" ".join(step["untrusted_text"] for step in steps))
        return None if found is None else [found[2], found[1]]

    def plan(self, category: str) -> list[str]:
        places = {one["iri"]: one["untrusted_label"] for one in self.call("describe_map")["places"]}
        looks = self.call("find_plan", what=[category], limit=100)["looks"]
        first = [look["reasons"][0]["iri"] for look in looks if look["reasons"]]
        return in_order(places.get(iri) or self._room_of(iri) for iri in first)

    def _room_of(self, iri: str) -> str | None:
        things = self.call("where_is", what=iri)["things"]
        return things[0]["untrusted_place"] if things else None

    def _of(self, category: str, room: str) -> list[Answer]:
        listed = self.call("what_is_in", what=room, limit=100)["things"]
        return [one for one in listed if one["untrusted_category"] == category]

    def _one(self, category: str, room: str) -> Answer | None:
        return next(iter(self._of(category, room)), None)

    def _around(self, category: str, room: str, radius: float) -> Sequence[Answer] | None:
        one = self._one(category, room)
        if one is None:
            return None
        found: Sequence[Answer] = self.call(
            "what_is_near", what=one["iri"], radius=radius, limit=100
        )["things"]
        return found


def _categories(things: Any) -> list[str] | None:
    return None if things is None else sorted({one["untrusted_category"] for one in things})
