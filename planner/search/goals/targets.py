"""Search targets: a category, a synonym, a supercategory, or a need such as a seat."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from kg.knowledge.words.meaning import understand
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import (
    QueryParameterError,
    UndetectableError,
    UnknownCategoryError,
    did_you_mean,
)
from mapping.looks.word_looks import compares_texts
from planner.search.goals.place_names import is_unnamed, object_named
from planner.search.goals.target_words import Undetectable, meaning_of, undetectable

_NEED: Final = re.compile(
    r"(?:(?:some|any)(?:thing|where|place)|a (?:thing|place|spot)|things|places|what)"
    r"(?: (?:i|one|we) can)?(?: to)? (.+)",
    re.IGNORECASE,
)
_NAMES: Final = ("label", "word", "folded")  # how names of single things are understood
_LINKS: Final = {"from", "on", "with", "in", "at", "out", "of"}


@dataclass(frozen=True, slots=True)
class Target:
    """Search target; any object of one of its kinds will do, or one `thing` alone."""

    text: str  # as given
    label: str  # in answers
    iri: str | None  # of its category; None for a need
    kinds: dict[str, str]  # IRI -> label of every category that will do
    above: dict[str, frozenset[str]]  # IRI -> labels of all supercategories of each kind
    note: str = ""  # how the text was understood, where it is not a category's own name
    second: frozenset[str] = frozenset()  # labels of the kinds that are not made for a need
    thing: str | None = None  # IRI of the one object that is wanted; any of its kinds without

    @property
    def none(self) -> str:
        """``No cup``, or ``Nothing to sit on``: the beginning of a sentence."""
        if self.thing:
            return f"No {self.label}"
        use = "" if self.iri else self.label.partition(" to ")[2]
        return f"Nothing to {use}" if use else f"No {self.label}"

    @property
    def kind(self) -> str:
        """Label of its category, also where one object is wanted; else its own."""
        return self.kinds.get(self.iri or "", self.label) if self.thing else self.label

    def accepts(self, category: str, iri: str | None) -> bool:
        """Whether an object with that IRI, of that category, is what is wanted."""
        return category in self.kinds if self.thing is None else iri == self.thing

    @property
    def queried(self) -> tuple[str, ...]:
        """IRIs of the categories to query; each includes its subcategories."""
        return (self.iri,) if self.iri else tuple(self.kinds)


def resolve(semantic_map: SemanticMap, texts: Sequence[str]) -> tuple[Target, ...]:
    """The targets that `texts` name, each once, in their order.

    A category's own name comes before a thing's label. Raises UndetectableError for a thing that no
    category includes, with its usual places, UnknownCategoryError for a text that is neither a word
    nor a need, and QueryParameterError for one thing that is not in the map.
    """
    found: dict[tuple[str | None, ...], Target] = {}
    for text in texts:
        target = _resolve(semantic_map, text)
        found.setdefault((target.thing, *target.queried), target)
    return tuple(found.values())


def as_one(semantic_map: SemanticMap, texts: Sequence[str]) -> list[str]:
    """Words that together are one name or one need, as that one: ``coffee`` ``mug``."""
    whole = " ".join(texts)
    if len(texts) < 2 or _need(semantic_map, whole):
        return [whole] if texts else []
    if object_named(semantic_map, whole):
        return [whole]
    if compares_texts(semantic_map) and any(_understood(semantic_map, t) is None for t in texts):
        return [whole]  # as in: red mug
    return [whole] if _understood(semantic_map, whole) in _NAMES else list(texts)


def _understood(semantic_map: SemanticMap, text: str) -> str | None:
    """How a text is understood; None for no known word."""
    try:
        return understand(semantic_map.catalogue, text).how
    except UnknownCategoryError:
        return None


def undetectable_target(semantic_map: SemanticMap, text: str) -> Undetectable | None:
    """The answer for a wanted thing that no category includes; None for any other text."""
    if _need(semantic_map, text) or _thing(semantic_map, text):
        return None
    return undetectable(semantic_map, text)


def _thing(semantic_map: SemanticMap, text: str) -> str:
    """IRI of the one object that a text names; "" for the names of kinds of things."""
    if semantic_map.catalogue.get(text, "object") is not None:
        return ""
    return object_named(semantic_map, text)


def _need(semantic_map: SemanticMap, text: str) -> str:
    """The words for a use in a text such as ``something to sit on``, or ""."""
    match = _NEED.fullmatch(text.strip())
    return "" if match is None or semantic_map.catalogue.get(text) is not None else match[1]


def _resolve(semantic_map: SemanticMap, text: str) -> Target:
    need = _need(semantic_map, text)
    if is_unnamed(text):
        count = len(semantic_map.unnamed_things())
        raise UnknownCategoryError(
            f"{count} things of the map have no name, so any of them is no target; one by its id, "
            "such as object/90, would work, and `hereabouts name MAP --review FILE.html` shows them"
        )
    if not need:
        return _named(semantic_map, text)
    kinds = _used_for(semantic_map, need)
    target = _target(semantic_map, text, text.strip(), None, kinds)
    second = frozenset(label for kind, label in target.kinds.items() if not kinds.get(kind, True))
    return replace(target, second=second)


def _named(semantic_map: SemanticMap, text: str) -> Target:
    """The target of a word; of several categories where the word includes them."""
    if iri := _thing(semantic_map, text):  # refuses cup 99, which is no misspelt cup
        return _one_thing(semantic_map, text, iri)
    try:
        meaning = meaning_of(semantic_map.catalogue, text)
    except UnknownCategoryError as error:
        answer = undetectable(semantic_map, text)
        if answer is None:
            raise
        raise UndetectableError(answer.answer) from error
    single = meaning.categories[0] if len(meaning.categories) == 1 else None
    label = single.label if single else meaning.text
    target = _target(semantic_map, text, label, single.iri if single else None, meaning.iris)
    return replace(target, note=meaning.note)


def _one_thing(semantic_map: SemanticMap, text: str, iri: str) -> Target:
    """The target that is one object of the map; raises QueryParameterError where it has left."""
    rows = semantic_map.query("whereabouts", object=iri).records()
    records = semantic_map.perceived.objects((iri,))
    if not rows or not records:
        raise QueryParameterError(
            f"{text[:60]!r} is not in the map now; `hereabouts status MAP '{text[:60]}'` tells its "
            "fate"
        )
    label = str(rows[0]["label"] or iri.removeprefix(semantic_map.base))
    category = _believed_category(semantic_map, iri)
    return replace(_target(semantic_map, text, label, category, [category]), thing=iri)


def _believed_category(semantic_map: SemanticMap, iri: str) -> str:
    """IRI of the category of an object, as people and perception together have it."""
    stated = [a.value for a in semantic_map.assertions.all(iri) if a.property == "category"]
    return stated[0] if stated else semantic_map.perceived.objects((iri,))[0].category


def _used_for(semantic_map: SemanticMap, words: str) -> dict[str, bool]:
    """Categories for a use, by its exact words, else without final prepositions.

    IRI -> whether they are made for it.
    """
    uses: dict[str, dict[str, bool]] = defaultdict(dict)
    for row in semantic_map.query("goals-needs").records():
        uses[str(row["use"])][str(row["kind"])] = bool(row["main"])
    for normalised in (_plain, _core):
        matches = [use for use in uses if normalised(use) == normalised(words)]
        if matches:
            return {iri: made for use in matches for iri, made in uses[use].items()}
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
