"""IRIs of agents and observations of a map, from its base IRI `base`."""

from __future__ import annotations

from typing import Final
from urllib.parse import quote, unquote

AGENT: Final = "agent/"  # followed by the percent-encoded name


def agent_iri(base: str, name: str) -> str:
    """IRI of the author `name` of transactions and assertions: ``<base>agent/NAME``."""
    return f"{base}{AGENT}{quote(name, safe='')}"


def agent_name(base: str, iri: str) -> str:
    """The name of the agent with that IRI; the inverse of `agent_iri`."""
    return unquote(iri.removeprefix(base + AGENT))


def observation_iri(base: str, thing: str) -> str:
    """IRI of the best observation (sosa:Observation) of the object `thing`."""
    local = thing.removeprefix(base + "object/")
    return thing + "/observation" if local == thing else f"{base}observation/{local}"
