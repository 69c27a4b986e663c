"""Provisional classes: categories created for labels of networks, and for names that people give.

A provisional category is a class below here:Object or here:Place, and below a supercategory of the
same name or the category that is nearest to a given name, with the mark ``here:provisional true``.
People later remove the mark or map the label to another category (docs/explanation/ontology.md).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import NAMED, Catalogue, name_key
from kg.knowledge.ontology.loading import check_grown, superclasses
from kg.model import vocabulary as v
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import subject_quads
from kg.store.transactional import TransactionalStore

MAX_LABEL: Final = 200  # characters
MAX_NOTE: Final = 500  # characters kept with the transaction

_IS_A: Final = NamedNode(v.IS_A)
_SUB_CLASS: Final = NamedNode(v.RDFS_SUB_CLASS_OF)
_MARK: Final = NamedNode(v.PROVISIONAL_MARK)
_ROOTS: Final = {"object": v.OBJECT, "place": v.PLACE, "name": v.OBJECT}
_COMMENTS: Final = {
    "object": "Provisional: what the object detector {model} calls so.",
    "place": "Provisional: what the scene classifier {model} calls so.",
    "name": "Provisional: what {model} named so.",
}


def clean(label: str) -> str:
    """Normalised label of a category: printable, single spaces, truncated; may be empty."""
    text = "".join(c if c.isprintable() else " " for c in label)
    return " ".join(text.split())[:MAX_LABEL].rstrip()


def provisional_iri(label: str, kind: str) -> str:
    """The IRI of the provisional category of a label; labels with one key share the IRI."""
    key = name_key(label)
    words = "".join(c if c.isalnum() else " " for c in label).split()
    camel = "".join(word[:1].upper() + word[1:] for word in words)
    plain = camel if camel.isascii() and name_key(camel) == key else key
    return f"{v.PROVISIONAL}{kind}#{quote(plain[:1].upper() + plain[1:], safe='')}"


def add_provisional_classes(
    store: TransactionalStore,
    catalogue: Catalogue,
    labels: Collection[str],
    kind: str,
    model: str,
    nearest: Collection[str] = (),
) -> ChangeSet | None:
    """Add a provisional category for each label to the map in `store`, in one transaction.

    `kind` is "object" or "place", or "name" for an object's name that the person `model` gave;
    `labels` are clean; `nearest` has the IRIs of further categories above the new ones. Existing
    categories are skipped.
    """
    new: dict[str, str] = {}
    for label in labels:
        iri = provisional_iri(label, kind)
        if catalogue.by_iri(iri) is None:
            new.setdefault(iri, label)
    if not new:
        return None
    hierarchy = [*store.engine.quads_for_pattern(None, _SUB_CLASS, None, v.ONTOLOGY_GRAPH)]
    above = superclasses(hierarchy)
    added: list[Quad] = []
    for iri, label in new.items():
        supers = [_ROOTS[kind], *nearest]
        if kind != "place" and (group := catalogue.get(label, "supercategory")) is not None:
            supers.append(group.iri)
        added += _category(iri, label, kind, model, supers)
        ancestors = {iri, *supers, *(a for parent in supers for a in above.get(parent, ()))}
        added += [
            Quad(NamedNode(iri), _IS_A, NamedNode(ancestor), v.COMMONSENSE_GRAPH)
            for ancestor in sorted(ancestors)
        ]
    check_grown(store.engine, added)
    names = ", ".join(new.values())
    cause = Cause("ontology", model, f"provisional {kind} categories: {names}"[:MAX_NOTE])
    return store.commit([], added, cause)


def remove_unused_name(store: TransactionalStore, iri: str, by: str | None) -> ChangeSet | None:
    """Remove the category that a person named, unless a fact of the map still refers to it."""
    node = NamedNode(iri)
    facts = (v.MAP_GRAPH, v.ASSERTIONS_GRAPH)
    used = (store.engine.quads_for_pattern(None, None, node, graph) for graph in facts)
    if not iri.startswith(NAMED) or any(next(iter(found), None) for found in used):
        return None
    gone = [
        quad
        for graph in (v.ONTOLOGY_GRAPH, v.COMMONSENSE_GRAPH)
        for quad in store.engine.quads_for_pattern(node, None, None, graph)
    ]
    below = store.engine.quads_for_pattern(None, _SUB_CLASS, node, v.ONTOLOGY_GRAPH)
    if next(iter(below), None) is not None or not gone:
        return None
    return store.commit(gone, [], Cause("ontology", by, f"removed the unused name {iri}"))


def provisional_to_keep(
    old: Iterable[Quad], new: Iterable[Quad], is_referenced: Callable[[NamedNode], bool]
) -> list[Quad]:
    """Quads of provisional categories and of words that `new` lacks and the map refers to.

    A network may add categories while people edit a file of the ontology.
    """
    old, declared = tuple(old), {q.subject for q in new if q.predicate == v.RDF_TYPE}
    kept = {
        q.subject
        for q in old
        if isinstance(q.subject, NamedNode)
        and (q.predicate == _MARK or q.subject.value.startswith(v.WORD))
        and q.subject not in declared
        and is_referenced(q.subject)
    }
    return [q for q in old if q.subject in kept]


def _category(iri: str, label: str, kind: str, model: str, supers: Iterable[str]) -> list[Quad]:
    properties: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, NamedNode(v.OWL_CLASS)),
        (v.RDFS_LABEL, Literal(label)),
        (v.RDFS_COMMENT, Literal(_COMMENTS[kind].format(model=clean(model)))),
        (v.DCT_SOURCE, Literal(clean(model))),
        (v.PROVISIONAL_MARK, Literal(True)),
        *((v.RDFS_SUB_CLASS_OF, NamedNode(above)) for above in supers),
    ]
    return subject_quads(iri, properties, v.ONTOLOGY_GRAPH)
