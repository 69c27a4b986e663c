"""IRIs of agents and observations of a map, from its base IRI `base`, and numbers in IRIs."""

from __future__ import annotations

from typing import Final
from urllib.parse import quote, unquote

MAX_DIGITS: Final = 18  # of a number in a text from outside: it fits 64 bits
MAX_NUMBER: Final = 10**15 - 1  # of an object that people name, and a count; so new ones exist
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


def whole_number(text: str) -> int | None:
    """The number that the decimal digits of `text` write, as in object/17.

    None for another text, and for more than `MAX_DIGITS` digits.
    """
    if not text.isascii() or not text.isdigit() or len(text) > MAX_DIGITS:
        return None
    return int(text)
