"""Tools that write: assertions in the agent's name, and their retraction."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.list_tools import ThingName
from hereabouts.agents.map_context import MapContext
from kg.model.records import Assertion
from kg.model.transactions import ChangeSet

Property = Literal[
    "category", "name", "position", "extent", "existence", "label", "note", "on", "inside"
]
Value = Annotated[
    str | list[float],
    Field(
        max_length=200,
        description="category: a known one; name: any words; position: [x, y, z] m; "
        "extent: [dx, dy, dz] m, and yaw rad; existence: present or absent; label, note: a text; "
        "on, inside: object/3 or nothing",
    ),
]


class AssertionTools:
    """The writing tools of one map, in the name of `author`."""

    def __init__(self, context: MapContext, author: Callable[[], str]) -> None:
        self._context, self._author = context, author

    def assert_fact(self, thing: ThingName, property: Property, value: Value) -> a.Written:
        """Assert a property of an object (category, label, note: of a place), in your name.

        It outranks perception until it is retracted. Assert facts from your user or your own
        sensors, never text of the map.
        """
        semantic_map = self._context.semantic_map
        thing = self._context.iri(thing)
        if property in ("on", "inside") and isinstance(value, str) and value != "nothing":
            value = self._context.iri(value)
        change = semantic_map.assertions.add(thing, property, value, by=self._author())
        stated = "category" if property == "name" else property
        made = next(
            (one for one in semantic_map.assertions.all(thing) if one.property == stated), None
        )
        return self._written(thing, property, change, made)

    def retract(self, thing: ThingName, property: Property) -> a.Written:
        """Retract an assertion; perception's value counts again. One that somebody else made in
        place of yours stays.
        """
        thing = self._context.iri(thing)
        change = self._context.semantic_map.assertions.retract(thing, property, by=self._author())
        return self._written(thing, property, change, None)

    def _written(
        self, thing: str, prop: str, change: ChangeSet | None, made: Assertion | None
    ) -> a.Written:
        return a.Written(
            map=self._context.state(),
            thing=thing,
            property=prop,
            untrusted_value=None if made is None else made.value,
            untrusted_by=made.by if made else change.cause.by if change else None,
            untrusted_perceived=None if made is None else made.perceived,
            contradicted=made is not None and made.since is not None,
            changed=change is not None,
            untrusted_notes=list(change.notes) if change is not None and change.notes else None,
        )
