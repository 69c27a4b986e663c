"""Classes of words: a vocabulary that ontologies import, and classes for labels of networks.

A sense whose things no category holds alone becomes a class below the category that includes it,
or below here:Object. Names that mean the same as a category become labels of that category.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, serialize

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key, readings
from kg.knowledge.ontology.loading import check_grown, superclasses
from kg.knowledge.words.meaning import shown_name, understand
from kg.knowledge.words.tables import DATA, Sense, word_table
from kg.model import vocabulary as v
from kg.model.errors import UnknownCategoryError
from kg.model.resources import table_rows
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import subject_quads
from kg.store.transactional import TransactionalStore

ONTOLOGY: Final = "https://w3id.org/hereabouts/ontology/words"

_WORDNET: Final = "http://purl.org/vocabularies/princeton/wn30/synset-{}-noun-{}"
_WORDNET_LICENCE: Final = "https://wordnet.princeton.edu/license-and-commercial-use"
_PREFIXES: Final = {
    "here": v.HERE,
    "word": v.WORD,
    "owl": "http://www.w3.org/2002/07/owl#",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
    "skos": "http://www.w3.org/2004/02/skos/core#",
    "dct": "http://purl.org/dc/terms/",
}
_MAX_NOTE: Final = 500  # characters kept with a transaction

#: IRI of a property, and its value
_Property = tuple[str, NamedNode | Literal]


def sense_of_label(label: str) -> Sense | None:
    """The sense of a network's label by exact or folded form, or None.

    Labels may list synonyms: ``sofa, couch, lounge`` or ``cabinet/shelf``; the first known one
    counts. A label with a qualifier in parentheses, such as ``bat (animal)``, has none: the words
    alone may mean something else.
    """
    if "(" in label:
        return None
    senses = word_table().senses
    for part in label.replace("_", " ").replace("/", ",").replace(";", ",").split(","):
        for key in readings(name_key(part)):
            if key in senses:
                return senses[key]
    return None


def class_iri(sense: Sense) -> str:
    """The IRI of the class of a sense."""
    return v.WORD + quote(sense.synset, safe="._-")


def class_quads(
    sense: Sense, catalogue: Catalogue, *, label: str = "", source: str = v.WORD_SOURCE
) -> tuple[Quad, ...]:
    """The class of a sense in graph:ontology.

    Args:
        sense: The sense; one whose relation is "same" is a category already.
        catalogue: Has the categories that include it.
        label: Label of the class; "" for its usual word.
        source: Name of the network that has the word as a label, or of WordNet.
    """
    found = (catalogue.get(one, "object") for one in sense.categories)
    above = [one.iri for one in found if one is not None and sense.relation == "narrower"]
    label = label or sense.words[0]
    properties: list[_Property] = [
        (v.RDF_TYPE.value, NamedNode(v.OWL_CLASS)),
        (v.RDFS_LABEL, Literal(label)),
        (v.RDFS_COMMENT, Literal(f"{sense.gloss or sense.words[0]} (WordNet: {sense.synset})")),
        (v.DCT_SOURCE, Literal(source)),
        *((v.RDFS_SUB_CLASS_OF, NamedNode(iri)) for iri in (v.OBJECT, *above)),
        *_names([word for word in sense.words if word != label], v.SKOS_ALT_LABEL),
        *_german(sense.words),
    ]
    if (synset := _in_wordnet(sense)) is not None:
        properties.append((v.RDFS_SEE_ALSO, NamedNode(synset)))
    return _quads(class_iri(sense), properties)


def add_label_classes(
    store: TransactionalStore, catalogue: Catalogue, labels: Iterable[str], model: str
) -> ChangeSet | None:
    """Store the meaning of a network's labels in the map in `store`, in one transaction.

    A label that means the same as a category becomes a name of it (skos:hiddenLabel). Any other
    known word becomes a class. Unknown words and names of supercategories are left out.
    """
    added: list[Quad] = []
    new: list[str] = []
    for label in labels:
        sense = sense_of_label(label)
        if sense is None or catalogue.get(label, "supercategory") is not None:
            continue
        new.append(label)
        same = catalogue.get(sense.categories[0], "object") if sense.relation == "same" else None
        if same is not None:
            added += _quads(same.iri, _names([label], v.SKOS_HIDDEN_LABEL))
        elif catalogue.by_iri(class_iri(sense)) is not None:
            names = [*_names([label], v.SKOS_HIDDEN_LABEL), (v.DCT_SOURCE, Literal(model))]
            added += _quads(class_iri(sense), names)
        else:
            added += class_quads(sense, catalogue, label=label, source=model)
    if not added:
        return None
    check_grown(store.engine, added)
    added += _closure(store, added)
    note = f"words for labels: {', '.join(new)}"[:_MAX_NOTE]
    return store.commit([], [*dict.fromkeys(added)], Cause("ontology", model, note))


def vocabulary_turtle(catalogue: Catalogue, words: Sequence[str] = ()) -> str:
    """An ontology of words as Turtle, which imports the categories and which Protege opens.

    Args:
        catalogue: Its categories are extended.
        words: Words whose senses are wanted; () for all that are known.

    Raises UnknownCategoryError for an unknown word.
    """
    table = word_table()
    senses = [_sense(catalogue, word) for word in words] or list(table.senses.values())
    quads: dict[Quad, None] = dict.fromkeys(_header())
    for sense in senses:
        same = _same(catalogue, sense)
        if same is None:
            quads |= dict.fromkeys(class_quads(sense, catalogue))
            continue
        known = {name_key(name) for name in (same.label, *same.synonyms, *same.hidden)}
        free = [w for w in sense.words if catalogue.get(w, "object") in (None, same)]
        more = [word for word in free if name_key(word) not in known]
        german = _german([*sense.words, same.label])
        quads |= dict.fromkeys(_quads(same.iri, [*_names(more, v.SKOS_ALT_LABEL), *german]))
    triples = [quad.triple for quad in quads]
    return (serialize(triples, format=RdfFormat.TURTLE, prefixes=_PREFIXES) or b"").decode()


def _same(catalogue: Catalogue, sense: Sense) -> Category | None:
    """The category that a sense is: it means the same, or has its label as its usual word."""
    if sense.relation == "same" or sense.words[0] in sense.categories:
        return catalogue.get(sense.categories[0], "object")
    return None


def _sense(catalogue: Catalogue, word: str) -> Sense:
    """The sense of a word as `understand` reads it."""
    meaning = understand(catalogue, word)
    sense = word_table().senses.get(name_key(meaning.means))
    if sense is None or meaning.how in ("head", "spelling"):
        raise UnknownCategoryError(
            f"no word '{shown_name(word)}' is known; `hereabouts ontology words` writes all words"
        )
    return sense


def _header() -> tuple[Quad, ...]:
    comment = (
        "Household words as classes and labels: nouns and senses of WordNet 3.0 (Copyright 2006 "
        "by Princeton University, WordNet licence), things of BEHAVIOR-1K (MIT), German labels of "
        "hereabouts. The licences of WordNet and BEHAVIOR-1K hold for what is theirs."
    )
    licences = "https://www.apache.org/licenses/LICENSE-2.0", _WORDNET_LICENCE
    return _quads(
        ONTOLOGY,
        [
            (v.RDF_TYPE.value, NamedNode(v.OWL_ONTOLOGY)),
            (v.OWL_IMPORTS, NamedNode("https://w3id.org/hereabouts/ontology/commonsense")),
            (v.RDFS_LABEL, Literal("hereabouts: words")),
            (v.RDFS_COMMENT, Literal(comment)),
            (v.OWL_VERSION_INFO, Literal("0.1.0")),
            *((v.DCT_LICENSE, NamedNode(licence)) for licence in licences),
        ],
    )


def _closure(store: TransactionalStore, added: Sequence[Quad]) -> Iterator[Quad]:
    """The here:isA of new classes."""
    sub_class = NamedNode(v.RDFS_SUB_CLASS_OF)
    hierarchy = store.engine.quads_for_pattern(None, sub_class, None, v.ONTOLOGY_GRAPH)
    new = {getattr(q.subject, "value", "") for q in added if q.predicate == v.RDF_TYPE}
    for iri, above in superclasses([*hierarchy, *added]).items():
        for ancestor in above if iri in new else ():
            yield Quad(NamedNode(iri), NamedNode(v.IS_A), NamedNode(ancestor), v.COMMONSENSE_GRAPH)


def _quads(subject: str, properties: Iterable[_Property]) -> tuple[Quad, ...]:
    return tuple(subject_quads(subject, properties, v.ONTOLOGY_GRAPH))


def _names(words: Iterable[str], predicate: str) -> list[_Property]:
    return [(predicate, Literal(word)) for word in words]


def _german(words: Iterable[str]) -> list[_Property]:
    keys = dict.fromkeys(name_key(word) for word in words)
    names = [name for key in keys for name in _german_names().get(key, ())]
    return [(v.SKOS_ALT_LABEL, Literal(name, language="de")) for name in dict.fromkeys(names)]


@lru_cache(maxsize=1)
def _german_names() -> Mapping[str, list[str]]:
    names: dict[str, list[str]] = defaultdict(list)
    for row in table_rows(DATA / "names_de.csv"):
        names[name_key(row["means"])].append(row["name"])
    return names


def _in_wordnet(sense: Sense) -> str | None:
    """The IRI of a sense in WordNet 3.0 as RDF; None for senses that WordNet does not have."""
    word, kind, number = sense.synset.rsplit(".", 2)
    if kind != "n" or "__" in word:
        return None
    return _WORDNET.format(quote(word, safe=""), int(number))
