"""Questions asked by the tools that agents have, through the package's own client."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import datetime
from typing import Any

from anyio.from_thread import start_blocking_portal
from mcp import Client
from mcp.client.stdio import StdioServerParameters

from lab.questions.graph_maps import AskedMap
from lab.questions.plain_map import NOT_KNOWN
from lab.questions.sparql_interfaces import SEEN_IN, in_order

Answer = dict[str, Any]
_BOX = re.compile(r"box (\d+) (\d+) (\d+) (\d+) px")


class McpInterface:
    """Each family by the tools of `hereabouts mcp URL`, over stdin and stdout."""

    def __init__(self, asked: AskedMap, url: str) -> None:
        self._since = asked.since
        words = ["-m", "hereabouts.cli", "mcp", url]
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
        return int(self.call("list_things", what=category, limit=1)["total"])

    def count_in_place(self, category: str, room: str) -> int:
        return int(self.call("list_things", inside=room, what=category, limit=1)["total"])

    def presence(self, category: str, room: str) -> bool:
        return self.never_looked(category, room) == "present"

    def nearest(self, category: str, to: str, to_room: str) -> list[float] | None:
        near = self._around(to, to_room, 100.0, what=category)
        return [near[0]["x"], near[0]["y"]] if near else None

    def within_radius(self, radius: float, of: str, of_room: str) -> list[str] | None:
        return _categories(self._around(of, of_room, radius))

    def between(self, one: str, one_room: str, other: str, other_room: str) -> list[str] | None:
        ends = self._one(one, one_room), self._one(other, other_room)
        if ends[0] is None or ends[1] is None:
            return None
        return _categories(self.pages("list_things", near=ends[0]["id"], to=ends[1]["id"]))

    def on_or_in(self, thing: str, thing_room: str) -> list[str] | None:
        carrier = self._one(thing, thing_room)
        if carrier is None:
            return None
        return _categories(self.pages("list_things", inside=carrier["id"]))

    def last_seen(self, category: str) -> float | None:
        found = self.call("where_is", what=category)
        known = [one for one in self.pages("where_is", what=category) if one["probability"] >= 0.5]
        known = [one for one in known if one["untrusted_category"] == category]
        times = [one["last_seen"] for one in (*known, *found.get("departed", ()))]
        return datetime.fromisoformat(max(times)).timestamp() if times else None

    def moved_since(self, room: str | None) -> list[str] | None:
        return self._changed("moved", room)

    def appeared_since(self, room: str | None) -> list[str] | None:
        return self._changed("appeared", room)

    def vanished_since(self, room: str | None) -> list[str] | None:
        return self._changed("gone", room)

    def _changed(self, kind: str, room: str | None) -> list[str] | None:
        places = self._places()
        listed = self.pages("what_changed", since=self._since)
        changed = [one for one in listed if one["kind"] == kind]
        return _categories(one for one in changed if room in (None, places.get(one.get("place"))))

    def past(self, category: str, room: str) -> int:
        then = {"inside": room, "what": category, "at": self._since}
        return int(self.call("list_things", limit=1, **then)["total"])

    def size(self, thing: str, thing_room: str) -> float | None:
        one = self._one(thing, thing_room)
        if one is None:
            return None
        query = f"SELECT ?x ?y {{ <{one['id']}> here:extentX ?x ; here:extentY ?y }}"
        rows = self.call("ask_sparql", query=query)["untrusted_rows"]
        return max(rows[0]) if rows else None

    def picture(self, thing: str, thing_room: str) -> list[Any] | None:
        told = self._told(thing, thing_room)
        found, box = SEEN_IN.search(told), _BOX.search(told)
        return [found[2], found[1], *map(int, box.groups())] if found and box else None

    def unanswerable(self, category: str, room: str) -> int | str:
        never = self.never_looked(category, room) == "never looked"
        return NOT_KNOWN if never else self.count_in_place(category, room)

    def never_looked(self, category: str, room: str) -> str:
        return str(self.call("status", what=category, place=room)["status"])

    def why(self, thing: str, thing_room: str) -> list[str] | None:
        found = SEEN_IN.search(self._told(thing, thing_room))
        return None if found is None else [found[2], found[1]]

    def _told(self, thing: str, thing_room: str) -> str:
        one = self._one(thing, thing_room)
        steps = [] if one is None else self.pages("why", "steps", what=one["id"])
        return " ".join(step["untrusted_text"] for step in steps)

    def plan(self, category: str) -> list[str]:
        places = self._places()
        looks = self.pages("find_plan", "looks", what=[category])
        first = [look["reasons"][0] for look in looks if look["reasons"]]
        return in_order(places.get(name) or self._room_of(name) for name in first)

    def pages(self, tool: str, listed: str = "things", **arguments: Any) -> list[Answer]:
        """All entries of a list, page by page."""
        page = self.call(tool, **arguments)
        found: list[Answer] = page[listed]
        while "more" in page:
            page = self.call(tool, skip=page["more"], **arguments)
            found += page[listed]
        return found

    def _places(self) -> dict[str | None, str]:
        listed = self.pages("describe_map", "places")
        return {one["id"]: one["untrusted_label"] for one in listed}

    def _room_of(self, name: str) -> str | None:
        things = self.call("where_is", what=name)["things"]
        return things[0].get("untrusted_place") if things else None

    def _one(self, category: str, room: str) -> Answer | None:
        found = self.call("list_things", inside=room, what=category, limit=1)["things"]
        return next(iter(found), None)

    def _around(
        self, category: str, room: str, radius: float, **only: str
    ) -> Sequence[Answer] | None:
        one = self._one(category, room)
        if one is None:
            return None
        return self.pages("list_things", near=one["id"], radius=radius, **only)


def _categories(things: Any) -> list[str] | None:
    return None if things is None else sorted({one["untrusted_category"] for one in things})
