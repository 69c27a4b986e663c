"""A thing as the graph has it, and where a server shows it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Final
from urllib.parse import quote

from pyoxigraph import BlankNode, NamedNode, Quad

from kg.engine import Engine
from kg.server.problems import Problem

MOST_OUT: Final = 1000  # facts of one thing that are shown
MOST_IN: Final = 200  # and facts that point at it
_SAFE_PATH: Final = "/:@!$&'()*+,;=-._~%"


@dataclass(frozen=True, slots=True)
class Thing:
    """A thing and the facts it stands in; `about` holds those of blank nodes it names as well."""

    iri: str
    about: tuple[Quad, ...]
    pointing: tuple[Quad, ...]


def look_up(engine: Engine, iri: str) -> Thing:
    """What the graph says of `iri`; Problem 404 where it says nothing."""
    try:
        node = NamedNode(iri)
    except ValueError as error:
        raise Problem(404, f"{iri[:200]!r} is no IRI this map could know") from error
    about = list(islice(engine.quads_for_pattern(node, None, None), MOST_OUT))
    for quad in about:
        if isinstance(quad.object, BlankNode) and len(about) < MOST_OUT:
            about += islice(engine.quads_for_pattern(quad.object, None, None), MOST_OUT)
    pointing = tuple(islice(engine.quads_for_pattern(None, None, node), MOST_IN))
    if not about and not pointing:
        raise Problem(404, f"this map knows of no {iri[:200]}")
    return Thing(iri, tuple(about), pointing)


def local_path(base: str, iri: str) -> str:
    """Where this server shows an IRI."""
    if iri.startswith(base):
        return "/" + quote(iri.removeprefix(base), safe=_SAFE_PATH)
    return "/resource?iri=" + quote(iri, safe="")
