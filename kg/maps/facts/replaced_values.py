"""Replaced values: notes of a transaction on the assertions of other people that it replaces."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from urllib.parse import unquote

from pyoxigraph import NamedNode, Quad

from kg.history.timestamps import span
from kg.knowledge.ontology.catalogue import Catalogue
from kg.model import vocabulary as v
from kg.model.iris import agent_name
from kg.model.records import Assertion
from kg.model.transactions import ChangeSet
from kg.rdf.literals import seconds


def noted(
    change: ChangeSet | None, base: str, catalogue: Catalogue, *notes: str
) -> ChangeSet | None:
    """The transaction with notes: those given, and one for each assertion of others it replaced."""
    if change is None:
        return None
    removed, added = (_assertions_in(quads) for quads in (change.removed, change.added))
    others = list(filter(None, notes))
    for node, was in removed.items():
        author = was.get(v.PROV_ATTRIBUTED_TO)
        if author is None or author == added.get(node, {}).get(v.PROV_ATTRIBUTED_TO):
            continue
        by = agent_name(base, author)
        if by == change.cause.by:
            continue
        subject, _, prop = node.removeprefix(f"{base}assertion/").rpartition("/")
        value = was.get(v.ASSERTED_VALUE, "") or "the same value"
        if prop == "category":
            known = catalogue.by_iri(value)
            value = value.rpartition("#")[2] if known is None else known.label
        value = value.removeprefix(base)
        # what both have in common, such as the second, is not among the changes
        when = was.get(v.PROV_GENERATED_AT)
        since = time.time() if when is None else seconds(when)
        done = "replaced" if node in added else "retracted"
        others.append(
            f"the {prop} of {unquote(subject)} that {by} asserted {ago(since)} ago was {done}: "
            f"{value}"
        )
    return replace(change, notes=tuple(others))


def _assertions_in(quads: Iterable[Quad]) -> dict[str, dict[str, str]]:
    """Values of assertions among quads, by IRI of the assertion and by predicate."""
    found: dict[str, dict[str, str]] = {}
    for quad in quads:
        if quad.graph_name == v.ASSERTIONS_GRAPH and isinstance(quad.subject, NamedNode):
            text = str(getattr(quad.object, "value", quad.object))
            found.setdefault(quad.subject.value, {})[quad.predicate.value] = text
    return found


def shown_value(assertion: Assertion, catalogue: Catalogue) -> str:
    """The value of an assertion in words: the label of a category, else its text."""
    return catalogue.label(assertion.value) if assertion.property == "category" else assertion.value


def ago(stamp: float) -> str:
    """The time since a moment [s since 1970] in words, to the second: ``4 s``, ``12 min``."""
    return span(max(time.time() - stamp, 0.0))
