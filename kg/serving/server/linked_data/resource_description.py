"""Facts of a resource, and its address on the server."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final
from urllib.parse import parse_qsl, quote

from pyoxigraph import BlankNode, NamedNode, Quad

from kg.rdf.quad_store import QuadStore
from kg.serving.server.http.problems import Problem

MAX_OUTGOING: Final = 1000  # facts of one resource that are shown
MAX_INCOMING: Final = 200  # facts that refer to it
_SAFE_PATH: Final = "/:@!$&'()*+,;=-._~%"


@dataclass(frozen=True, slots=True)
class ResourceDescription:
    """A resource, the facts `about` it (and its blank nodes), and the facts that refer to it."""

    iri: str
    about: tuple[Quad, ...]
    referring: tuple[Quad, ...]


def look_up(engine: QuadStore, iri: str, derived: Sequence[Quad] = ()) -> ResourceDescription:
    """Stored and derived facts of `iri`; Problem 404 if there are none."""
    try:
        node = NamedNode(iri)
    except ValueError as error:
        raise Problem(404, f"{iri[:200]!r} is not a valid IRI") from error
    about = list(islice(engine.quads_for_pattern(node, None, None), MAX_OUTGOING))
    for quad in about:
        if isinstance(quad.object, BlankNode) and len(about) < MAX_OUTGOING:
            about += islice(engine.quads_for_pattern(quad.object, None, None), MAX_OUTGOING)
    referring = tuple(islice(engine.quads_for_pattern(None, None, node), MAX_INCOMING))
    about += [quad for quad in derived if quad not in about]
    if not about and not referring:
        raise Problem(404, f"this map has no {iri[:200]}")
    return ResourceDescription(iri, tuple(about), referring)


def iri_at(base: str, root: str, address: str) -> str:
    """The IRI of the resource at an address of this server, `root`; other IRIs stay as they are.

    A proxy may have merged the slashes behind the scheme of `address`.
    """
    address = re.sub(r"^(https?):/+", r"\1://", address)
    if not address.startswith(root):
        return address
    path, _, query = address.removeprefix(root).partition("?")
    if path == "resource":
        return dict(parse_qsl(query)).get("iri", "")
    return base + path


def local_path(base: str, iri: str) -> str:
    """Path of an IRI on this server; it never begins with ``//``, the address of another host."""
    if iri.startswith(base) and not iri.startswith(base + "/"):
        return "/" + quote(iri.removeprefix(base), safe=_SAFE_PATH)
    return "/resource?iri=" + quote(iri, safe="")
