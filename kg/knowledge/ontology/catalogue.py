"""Catalogue of categories: maps names of people and networks to IRIs, and back."""

from __future__ import annotations

import re
import threading
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.loading import (
    compile_commonsense,
    ontology_files,
    read_files,
    superclasses,
)
from kg.model import vocabulary as v
from kg.model.errors import UnknownCategoryError, did_you_mean
from kg.model.resources import ONTOLOGIES
from kg.rdf.quad_store import QuadStore
from kg.rdf.skolem import named

#: In this order of precedence for a name that two kinds share.
KINDS: Final = ("object", "supercategory", "place")


@dataclass(frozen=True, slots=True)
class Category:
    """A category; `kind` is "object", "place", "supercategory" or "unnamed thing"."""

    iri: str
    label: str
    kind: str
    synonyms: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()  # names only in vocabularies of networks
    provisional: bool = False  # created for a network's label that had no category
    undetected: bool = False  # class of a word that no network has as a label

    @property
    def derived(self) -> bool:
        """Whether it was made of a label or a word; names that people write come before its own."""
        return self.provisional or self.iri.startswith(v.WORD)


#: what IRIs of categories that people named begin with
NAMED: Final = f"{v.PROVISIONAL}name#"
#: what things are that nobody named; no list of categories has it
_UNNAMED: Final = Category(v.UNNAMED_THING, "unnamed thing", "unnamed thing")


@dataclass(frozen=True, slots=True)
class Catalogue:
    """All categories of an ontology: objects, supercategories, places, each sorted by label."""

    categories: tuple[Category, ...]
    _by_iri: dict[str, Category] = field(init=False, repr=False, compare=False)
    _by_key: dict[str, list[Category]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        by_key: dict[str, list[Category]] = defaultdict(list)
        real = [c for c in self.categories if not c.derived]
        for category in real:  # a label takes precedence over another category's synonym
            by_key[name_key(category.label)].append(category)
        named = [(name, c) for c in real for name in (*c.synonyms, *c.hidden, _local_name(c.iri))]
        derived = [c for c in self.categories if c.derived]
        named += [(c.label, c) for c in derived]
        named += [(name, c) for c in derived for name in (*c.synonyms, *c.hidden)]
        for name, category in named:
            if category not in by_key[name_key(name)]:
                by_key[name_key(name)].append(category)
        known = (_UNNAMED, *self.categories)
        object.__setattr__(self, "_by_iri", {c.iri: c for c in known})
        object.__setattr__(self, "_by_key", dict(by_key))

    @classmethod
    def from_quads(cls, quads: Iterable[Quad]) -> Catalogue:
        """The categories in an ontology's quads.

        Objects are the subclasses of here:Object, places the subclasses of here:Place,
        supercategories the other named superclasses of objects. A class without a label has its
        local name as label.
        """
        quads = tuple(quads)
        labels, synonyms, hidden = _names(quads)
        provisional, detected = _provisional(quads), _detected_words(quads)
        found = [
            Category(
                iri,
                labels.get(iri, _local_name(iri)),
                kind,
                tuple(synonyms[iri]),
                tuple(hidden[iri]),
                iri in provisional,
                iri.startswith(v.WORD) and iri not in detected,
            )
            for iri, kind in _kinds(superclasses(quads)).items()
        ]
        return cls(tuple(sorted(found, key=lambda c: (KINDS.index(c.kind), c.label, c.iri))))

    @classmethod
    def from_store(cls, store: QuadStore) -> Catalogue:
        """The categories of the ontology in a map's store; other facts of it are not read."""
        graph, read = v.ONTOLOGY_GRAPH, store.quads_for_pattern
        return cls.from_quads(q for p in _READ for q in read(None, NamedNode(p), None, graph))

    def find(self, label: str, kind: str | None = None) -> Category:
        """The category with that label, synonym, simple plural, class name or IRI.

        Case, spaces, underscores, hyphens and other marks are ignored. `kind` narrows the search.
        Derived categories (provisional ones, and those of words) come last.

        Raises:
            UnknownCategoryError: no category has that name; the message suggests similar ones.
        """
        category = self.get(label, kind)
        if category is not None:
            return category
        other = self.get(label)
        if other is not None:
            article = "an" if other.kind[0] in "ou" else "a"
            raise UnknownCategoryError(
                f"no {kind} category {label!r}: that is {article} {other.kind}"
            )
        names = [n for c in self._of(kind) for n in (c.label, *c.synonyms)]
        close = did_you_mean(label, names) or f" among the {len(self._of(kind))} of this map"
        raise UnknownCategoryError(f"no {f'{kind} ' if kind else ''}category {label!r}{close}")

    def get(self, label: str, kind: str | None = None) -> Category | None:
        """As `find`, but None for an unknown label."""
        if (exact := self._by_iri.get(label)) is not None:
            return exact if kind in (None, exact.kind) else None
        found = (self.named(key, kind) for key in readings(name_key(label)))
        return next(filter(None, found), None)

    def named(self, key: str, kind: str | None = None) -> Category | None:
        """The first category with a name of exactly that key (`name_key`), or None."""
        for category in self._by_key.get(key, ()):
            if kind in (None, category.kind):
                return category
        return None

    def for_label(self, label: str, kind: str) -> Category | None:
        """The category of a network's `label`, as `get` without plurals of derived categories.

        So the meaning of a label does not depend on the order of a network's labels.
        """
        category = self.get(label, kind)
        if category is not None and category.derived:
            exact = self._by_key.get(name_key(label), ())
            return next((c for c in exact if c.kind == kind), None)
        return category

    def by_iri(self, iri: str) -> Category | None:
        """The category with that IRI, or None."""
        return self._by_iri.get(iri)

    def label(self, iri: str) -> str:
        """Label of the category with that IRI.

        Raises:
            UnknownCategoryError: no category has that IRI.
        """
        if (category := self._by_iri.get(iri)) is None:
            raise UnknownCategoryError(f"no category has the IRI {iri}")
        return category.label

    def is_given_name(self, label: str) -> bool:
        """Whether a label is the name that a person gave, which is no common noun."""
        known = self.get(label, "object")
        return known is not None and known.iri.startswith(NAMED)

    def title(self, category: str, iri: str) -> str:
        """Title of the object `iri` of a category (IRI): ``cup 17``; a person's name as it is."""
        label = self.label(category)
        if category.startswith(NAMED):
            return label
        return f"{label} {iri.rstrip('/').rpartition('/')[2]}"

    def _of(self, kind: str | None) -> list[Category]:
        return [c for c in self.categories if kind in (None, c.kind)]


#: predicates of the facts that say what categories there are
_READ: Final = (
    *(v.RDF_TYPE.value, v.RDFS_SUB_CLASS_OF, v.RDFS_LABEL, v.SKOS_ALT_LABEL, v.SKOS_HIDDEN_LABEL),
    *(v.PROVISIONAL_MARK, v.DCT_SOURCE),
)


class StoredCatalogue:
    """Lazily read categories of a stored ontology.

    Reading them takes longer than opening a map, and many queries do not need them.
    """

    def __init__(self, store: Callable[[], QuadStore], known: Catalogue | None = None) -> None:
        """`store` returns the open store; `known` has its categories if they were read before."""
        self._store = store
        self._known = known
        self._changes = 0
        self._lock = threading.Lock()

    @property
    def known(self) -> Catalogue | None:
        """The categories, if they have been read."""
        return self._known

    def __call__(self) -> Catalogue:
        """All categories; raises as `store` does."""
        known, changes = self._known, self._changes
        if known is None:
            known = Catalogue.from_store(self._store())
            with self._lock:
                if changes == self._changes:
                    self._known = known
        return known

    def forget(self) -> None:
        """Invalidate the cached categories after a change of the stored ontology."""
        with self._lock:
            self._changes += 1
            self._known = None


def name_key(name: str) -> str:
    """Lookup key of a name: case-folded, without spaces, hyphens and other marks.

    A name without letters and digits only loses its spaces.
    """
    name = name.removeprefix("here:")
    if name.isascii() and (plain := "".join(filter(str.isalnum, name))):
        return plain.lower()
    folded = unicodedata.normalize("NFKC", name).casefold()
    folded = unicodedata.normalize("NFKC", folded)
    if not any(c.isalnum() for c in folded):
        return "".join(folded.split())
    # vowel signs of some scripts are combining marks (M*) and distinguish words
    return "".join(c for c in folded if c.isalnum() or unicodedata.category(c)[0] == "M")


def readings(key: str) -> Iterator[str]:
    """The key of a name, then keys of possible singular and plural forms."""
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


def _names(
    quads: tuple[Quad, ...],
) -> tuple[dict[str, str], dict[str, list[str]], dict[str, list[str]]]:
    """Labels, synonyms and hidden labels by IRI.

    A label without language has precedence, then English, then any other.
    """
    labels: dict[str, list[tuple[int, str]]] = defaultdict(list)
    others: dict[str, dict[str, set[str]]] = {
        v.SKOS_ALT_LABEL: defaultdict(set),
        v.SKOS_HIDDEN_LABEL: defaultdict(set),
    }
    for q in quads:
        if not isinstance(q.subject, NamedNode) or not isinstance(q.object, Literal):
            continue
        language = q.object.language
        if q.predicate.value == v.RDFS_LABEL:
            rank = 0 if not language else 1 if language.startswith("en") else 2
            labels[q.subject.value].append((rank, q.object.value))
        elif q.predicate.value in others:
            others[q.predicate.value][q.subject.value].add(q.object.value)
    best = {iri: min(given)[1] for iri, given in labels.items()}
    for iri, given in labels.items():
        more = {name for _, name in given if name != best[iri]}
        others[v.SKOS_ALT_LABEL][iri] |= more
    synonyms, hidden = (
        defaultdict(list, {iri: sorted(names) for iri, names in found.items()})
        for found in others.values()
    )
    return best, synonyms, hidden


def _provisional(quads: tuple[Quad, ...]) -> set[str]:
    marked = (q for q in quads if q.predicate.value == v.PROVISIONAL_MARK)
    return {_text(q.subject) for q in marked if _text(q.object) in ("true", "1")}


def _detected_words(quads: tuple[Quad, ...]) -> set[str]:
    """Classes of words that came from a network: their source is not WordNet alone."""
    sourced = (q for q in quads if q.predicate.value == v.DCT_SOURCE)
    return {_text(q.subject) for q in sourced if _text(q.object) != v.WORD_SOURCE}


def _text(term: object) -> str:
    return str(getattr(term, "value", ""))


def _local_name(iri: str) -> str:
    return re.split("[#/:]", iri)[-1]


@dataclass(frozen=True, slots=True)
class CarrierKinds:
    """IRIs of categories that objects may be on or inside of, subclasses included."""

    supports: frozenset[str]
    containers: frozenset[str]
    backs: Mapping[str, float]  # [m] usual height of backrest or headboard over the surface


def carrier_kinds(ontology: Iterable[Quad]) -> CarrierKinds:
    """The carriers declared in an ontology's quads."""
    ontology = tuple(ontology)
    carried: dict[str, set[str]] = {v.ON: set(), v.INSIDE: set()}
    backs: dict[str, float] = {}
    for quad in ontology:
        value = str(getattr(quad.object, "value", ""))
        if not isinstance(quad.subject, NamedNode):
            continue
        if quad.predicate.value == v.CARRIES and value in carried:
            carried[value].add(quad.subject.value)
        elif quad.predicate.value == v.BACK_HEIGHT:
            backs[quad.subject.value] = float(value)
    above = superclasses(ontology)
    return CarrierKinds(
        frozenset(iri for iri, kinds in above.items() if carried[v.ON] & {*kinds}),
        frozenset(iri for iri, kinds in above.items() if carried[v.INSIDE] & {*kinds}),
        {
            iri: max(backs[kind] for kind in kinds if kind in backs)
            for iri, kinds in above.items()
            if any(kind in backs for kind in kinds)
        },
    )


@dataclass(frozen=True, slots=True)
class CompiledOntology:
    """The quads of graph:ontology and graph:commonsense, and the categories they declare."""

    quads: tuple[Quad, ...]
    catalogue: Catalogue


def shipped_ontology() -> CompiledOntology:
    """The ontology of hereabouts, recompiled only after a change of its files.

    Raises OntologyError if a file does not parse.
    """
    files = ontology_files(ONTOLOGIES)
    return _compiled(tuple((path, path.read_bytes()) for path in files))


@lru_cache(maxsize=1)
def _compiled(contents: tuple[tuple[Path, bytes], ...]) -> CompiledOntology:
    # the contents are the cache key; files are read by name, so that errors have the names
    ontology = named(read_files(path for path, _ in contents).quads)
    return CompiledOntology(
        (*ontology, *compile_commonsense(ontology)), Catalogue.from_quads(ontology)
    )
