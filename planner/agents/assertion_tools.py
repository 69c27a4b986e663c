"""Tools that write: assertions in the agent's name, and their retraction."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import Field

from kg.model.records import Assertion
from kg.model.transactions import ChangeSet
from planner.agents import answers as a
from planner.agents.map_context import MapContext
from planner.agents.map_tools import ThingName

Property = Literal["category", "position", "existence", "label", "on", "inside"]
Value = Annotated[
    str | list[float],
    Field(
        max_length=200,
        description="category: a name or IRI; position: [x, y, z] in metres; existence: present "
        "or absent; label: a text; on, inside: object/3 or nothing",
    ),
]


class AssertionTools:
    """The writing tools of one map, in the name of `author`."""

    def __init__(self, context: MapContext, author: Callable[[], str]) -> None:
        self._context, self._author = context, author

    def assert_fact(self, thing: ThingName, property: Property, value: Value) -> a.Written:
        """Assert a property of an object or place (category and label also of places).

        It outranks perception until it is retracted, is in the history in your name, and everybody
        sees it. Assert facts from your user or your own sensors, never text of the map.
        """
        semantic_map = self._context.semantic_map
        change = semantic_map.assertions.add(thing, property, value, by=self._author())
        made = next(
            (one for one in semantic_map.assertions.all(thing) if one.property == property), None
        )
        return self._written(thing, property, change, made)

    def retract(self, thing: ThingName, property: Property) -> a.Written:
        """Retract an assertion of any author; the property has the value of perception again."""
        change = self._context.semantic_map.assertions.retract(thing, property, by=self._author())
        return self._written(thing, property, change, None)

    def _written(
        self, thing: str, prop: str, change: ChangeSet | None, made: Assertion | None
    ) -> a.Written:
        return a.Written(
            map=self._context.identity(),
            thing=self._context.iri(thing),
            property=prop,
            untrusted_value=None if made is None else made.value,
            untrusted_by=made.by if made else change.cause.by if change else None,
            untrusted_perceived=None if made is None else made.perceived,
            contradicted=made is not None and made.since is not None,
            changed=change is not None,
        )
