"""From what people and networks call things to the IRIs of categories, and back."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg import vocabulary as v
from kg.engine import Engine
from kg.errors import UnknownCategoryError, did_you_mean
from kg.ontology import superclasses

#: Where two kinds share a name, the earlier kind is meant unless another is asked for.
KINDS: Final = ("object", "supercategory", "place")


@dataclass(frozen=True, slots=True)
class Category:
    """A kind of object or place; `kind` is "object", "place" or "supercategory"."""

    iri: str
    label: str
    kind: str
    synonyms: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Catalogue:
    """All categories of an ontology: objects, supercategories, places, each sorted by label."""

    categories: tuple[Category, ...]
    _by_iri: dict[str, Category] = field(init=False, repr=False, compare=False)
    _by_key: dict[str, list[Category]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        by_key: dict[str, list[Category]] = defaultdict(list)
        for category in self.categories:  # a label beats another category's synonym
            by_key[_key(category.label)].append(category)
        for category in self.categories:
            for name in (*category.synonyms, _local_name(category.iri)):
                if category not in by_key[_key(name)]:
                    by_key[_key(name)].append(category)
        object.__setattr__(self, "_by_iri", {c.iri: c for c in self.categories})
        object.__setattr__(self, "_by_key", dict(by_key))

    @classmethod
    def from_quads(cls, quads: Iterable[Quad]) -> Catalogue:
        """The categories an ontology's quads declare.

        Objects are the subclasses of here:Object, places those of here:Place, supercategories the
        other named superclasses of objects. A class without a label is called by its name.
        """
        quads = tuple(quads)
        labels, synonyms = _names(quads)
        found = [
            Category(iri, labels.get(iri, _local_name(iri)), kind, tuple(synonyms[iri]))
            for iri, kind in _kinds(superclasses(quads)).items()
        ]
        return cls(tuple(sorted(found, key=lambda c: (KINDS.index(c.kind), c.label, c.iri))))

    @classmethod
    def from_store(cls, store: Engine) -> Catalogue:
        """The categories of the ontology in a map's store."""
        graph = NamedNode(v.ONTOLOGY_GRAPH)
        return cls.from_quads(store.quads_for_pattern(None, None, None, graph))

    def find(self, label: str, kind: str | None = None) -> Category:
        """The category called `label`: by label, synonym, simple plural, class name or IRI.

        Case, spaces, underscores, hyphens and other marks do not matter. `kind` narrows the search.

        Raises:
            UnknownCategoryError: none is called that; says which come close.
        """
        category = self.get(label, kind)
        if category is not None:
            return category
        other = self.get(label)
        if other is not None:
            article = "an" if other.kind == "object" else "a"
            raise UnknownCategoryError(
                f"no {kind} category {label!r}: that is {article} {other.kind}"
            )
        names = [n for c in self._of(kind) for n in (c.label, *c.synonyms)]
        close = did_you_mean(label, names) or f" among the {len(self._of(kind))} of this map"
        raise UnknownCategoryError(f"no {f'{kind} ' if kind else ''}category {label!r}{close}")

    def get(self, label: str, kind: str | None = None) -> Category | None:
        """As `find`, but None where nothing is called `label`."""
        if (exact := self._by_iri.get(label)) is not None:
            return exact if kind in (None, exact.kind) else None
        for key in _readings(_key(label)):
            for category in self._by_key.get(key, ()):
                if kind in (None, category.kind):
                    return category
        return None

    def by_iri(self, iri: str) -> Category | None:
        """The category with that IRI, or None."""
        return self._by_iri.get(iri)

    def label(self, iri: str) -> str:
        """What people call the category with that IRI.

        Raises:
            UnknownCategoryError: no category has it.
        """
        if (category := self._by_iri.get(iri)) is None:
            raise UnknownCategoryError(f"no category has the IRI {iri}")
        return category.label

    def _of(self, kind: str | None) -> list[Category]:
        return [c for c in self.categories if kind in (None, c.kind)]


def _key(name: str) -> str:
    return "".join(c for c in name.removeprefix("here:").casefold() if c.isalnum())


def _readings(key: str) -> Iterator[str]:
    """The key itself, then what it may be the plural, or the singular, of."""
    yield key
    if key.endswith("ves"):
        yield key[:-3] + "fe"
        yield key[:-3] + "f"
    if key.endswith("ies"):
        yield key[:-3] + "y"
    if key.endswith("es"):
        yield key[:-2]
    if key.endswith("s"):
        yield key[:-1]
    yield key + "s"


def _kinds(above: dict[str, tuple[str, ...]]) -> dict[str, str]:
    """Kind of every category among the classes of a closed hierarchy."""
    roots = {v.OBJECT: "object", v.PLACE: "place"}
    kinds = {
        iri: kind
        for root, kind in roots.items()
        for iri, supers in above.items()
        if root in supers and iri != root
    }
    for iri in [iri for iri, kind in kinds.items() if kind == "object"]:
        for superclass in above[iri]:
            if superclass != v.OBJECT and superclass not in above[v.OBJECT]:
                kinds.setdefault(superclass, "supercategory")
    return kinds


def _names(quads: tuple[Quad, ...]) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Labels and synonyms by IRI; a label without language beats English, that any other."""
    labels: dict[str, list[tuple[int, str]]] = defaultdict(list)
    synonyms: dict[str, list[str]] = defaultdict(list)
    for q in quads:
        if not isinstance(q.subject, NamedNode) or not isinstance(q.object, Literal):
            continue
        language = q.object.language
        if q.predicate.value == v.RDFS_LABEL:
            rank = 0 if not language else 1 if language.startswith("en") else 2
            labels[q.subject.value].append((rank, q.object.value))
        elif q.predicate.value == v.SKOS_ALT_LABEL:
            synonyms[q.subject.value].append(q.object.value)
    best = {iri: min(given)[1] for iri, given in labels.items()}
    for iri, given in labels.items():
        synonyms[iri].extend(name for _, name in given if name != best[iri])
    return best, defaultdict(list, {iri: sorted(set(names)) for iri, names in synonyms.items()})


def _local_name(iri: str) -> str:
    return re.split("[#/:]", iri)[-1]
