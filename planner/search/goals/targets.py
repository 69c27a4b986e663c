"""Search targets: a category, a synonym, a supercategory, or a need such as a seat."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError, did_you_mean
from planner.search.goals.search_goals import resolve_target

_NEED: Final = re.compile(
    r"(?:(?:some|any)(?:thing|where|place)|a thing|things|what)(?: (?:i|one|we) can)?(?: to)? (.+)",
    re.IGNORECASE,
)
_LINKS: Final = {"from", "on", "with", "in", "at", "out", "of"}


@dataclass(frozen=True, slots=True)
class Target:
    """Search target; any object of one of its kinds will do."""

    text: str  # as given
    label: str  # in answers
    iri: str | None  # of its category; None for a need
    kinds: dict[str, str]  # IRI -> label of every category that will do
    above: dict[str, frozenset[str]]  # IRI -> labels of all supercategories of each kind

    @property
    def queried(self) -> tuple[str, ...]:
        """IRIs of the categories to query; each includes its subcategories."""
        return (self.iri,) if self.iri else tuple(self.kinds)


def resolve(semantic_map: SemanticMap, texts: Sequence[str]) -> tuple[Target, ...]:
    """The targets that `texts` name, each once, in their order.

    Raises UnknownCategoryError for a text that is neither a category nor a need.
    """
    found: dict[tuple[str, ...], Target] = {}
    for text in texts:
        target = _resolve(semantic_map, text)
        found.setdefault(target.queried, target)
    return tuple(found.values())


def _resolve(semantic_map: SemanticMap, text: str) -> Target:
    match = _NEED.fullmatch(text.strip())
    if match is None or semantic_map.catalogue.get(text) is not None:
        category = resolve_target(semantic_map.catalogue, text)
        return _target(semantic_map, text, category.label, category.iri, [category.iri])
    kinds = _used_for(semantic_map, match[1])
    return _target(semantic_map, text, text.strip(), None, kinds)


def _used_for(semantic_map: SemanticMap, words: str) -> list[str]:
    """IRIs of the categories for a use: by its exact words, else without final prepositions."""
    uses: dict[str, list[str]] = defaultdict(list)
    for row in semantic_map.query("goals-needs").records():
        uses[str(row["use"])].append(str(row["kind"]))
    for normalised in (_plain, _core):
        matches = [use for use in uses if normalised(use) == normalised(words)]
        if matches:
            return list(dict.fromkeys(iri for use in matches for iri in uses[use]))
    near = did_you_mean(words, uses) or ";"
    raise UnknownCategoryError(
        f"nothing is said to be used for '{words}'{near} there is something to "
        f"{', '.join(sorted(uses)) or 'nothing'}"
    )


def _plain(words: str) -> str:
    return " ".join(re.findall(r"\w+", words.casefold()))


def _core(words: str) -> str:
    parts = _plain(words).split()
    while len(parts) > 1 and parts[-1] in _LINKS:
        parts.pop()
    return " ".join(parts)


def _target(
    semantic_map: SemanticMap, text: str, label: str, iri: str | None, queried: Iterable[str]
) -> Target:
    kinds: dict[str, str] = {}
    above: dict[str, set[str]] = defaultdict(set)
    for category in queried:
        for row in semantic_map.query("goals-kinds", category=category).records():
            kinds[str(row["kind"])] = str(row["category"])
            above[str(row["kind"])].add(str(row["above"]))
    return Target(text, label, iri, kinds, {k: frozenset(v) for k, v in above.items()})
