"""ConceptNet import: reads a source, aggregates relations, merges them into a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.conceptnet.api import ApiClient, ResponseCache, read_api
from kg.knowledge.conceptnet.collecting import EdgeCollection
from kg.knowledge.conceptnet.dump import DumpStatistics, Progress, read_dump
from kg.knowledge.conceptnet.edges import Edge, EdgeFilter
from kg.knowledge.conceptnet.names import TermMatcher
from kg.knowledge.conceptnet.relate import ImportedRelation, relate
from kg.knowledge.conceptnet.review import apply_review, read_review, review_text
from kg.knowledge.conceptnet.turtle import (
    ImportedFile,
    RelationChange,
    merge,
    read_imported_file,
)
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies, superclasses
from kg.model import vocabulary as v
from kg.model.errors import ConceptNetError
from kg.model.resources import ONTOLOGIES
from kg.store.atomic_file import write_atomically


@dataclass(frozen=True, slots=True)
class ConceptNetImport:
    """Result of an import: relations found, and changes to the file."""

    found: tuple[ImportedRelation, ...]  # all relations the source supports
    changes: tuple[RelationChange, ...]  # to the file, or to an empty file
    written: bool  # whether the file has changed
    used: int  # assertions about the categories
    weak: int  # relations with too few votes for, or too many against
    lines: int  # lines of the file, or edges of the answers
    requests: int  # to the web API, without cached ones
    skipped: Counter[str]  # malformed lines or edges, by reason


def import_conceptnet(
    source: str | Path,
    into: Path | None = None,
    *,
    language: str = "en",
    ontologies: Path = ONTOLOGIES,
    review: Path | None = None,
    dry_run: bool = False,
    cache: Path | None = None,
    client: ApiClient | None = None,
    progress: Progress = lambda done, total: None,
) -> ConceptNetImport:
    """Import ConceptNet's relations between the categories of an ontology.

    Args:
        source: file (ConceptNet 5 TSV or ConceptNet 4 graph, plain or gzip), or the address of a
            web API, such as http://api.conceptnet.io.
        into: the Turtle file to write. A file of an earlier import is updated; edits by people are
            kept. None: nothing is written.
        language: language of the assertions, as a code of ConceptNet.
        ontologies: folder of the ontologies with the categories; `into` is not read there.
        review: table (CSV) of the relations with their sentences. Relations with keep = no in it
            are left out, now and at later imports; then the table is written anew.
        dry_run: compute the changes without writing them.
        cache: folder for responses of the web API; an interrupted import resumes from there.
        client: a client of the web API to use instead of `source`'s address.
        progress: callback with the number of bytes (or requests) done, and the total.

    Raises:
        ConceptNetError: the source, the file or the review cannot be read, or the source has no
            assertion about the categories.
        GraphError: the file cannot be written.
        OntologyError: the ontologies cannot be read.
    """
    previous = ImportedFile() if into is None else read_imported_file(into)
    if review is not None:
        if into is None:
            raise ConceptNetError(f"the review {review} needs the file to import into (--into)")
        apply_review(previous, read_review(review))
    quads = load_ontologies(ontologies, without=into).quads
    catalogue = Catalogue.from_quads(quads)
    above = superclasses(quads)
    kinds = {c.iri for c in catalogue.categories if c.kind == "supercategory"}
    groups = {iri: tuple(one for one in ups if one in kinds) for iri, ups in above.items()}
    collection = EdgeCollection(TermMatcher(catalogue, _wider_kinds(quads, above)))
    statistics = DumpStatistics()
    with _assertions(
        source, language, collection, statistics, cache, client, progress
    ) as assertions:
        used = collection.add_all(assertions)
    if not used and into is not None:  # the import would empty the file
        raise ConceptNetError(
            f"{source} has no assertion about these categories in the language {language!r} "
            f"({statistics.lines} assertions read): ConceptNet calls English 'en', German 'de'"
        )
    found, weak = relate(collection, groups)
    text, changes = merge(previous, found)
    changed = into is not None and not (into.exists() and into.read_bytes() == text.encode())
    if into is not None and changed and not dry_run:
        write_atomically(into, text)
    if review is not None and not dry_run:
        write_atomically(review, review_text(found, previous))
    return ConceptNetImport(
        *(found, tuple(changes), changed and not dry_run, used, weak),
        *(statistics.lines, statistics.requests, statistics.skipped),
    )


def _wider_kinds(
    quads: Iterable[Quad], above: Mapping[str, tuple[str, ...]]
) -> dict[str, frozenset[str]]:
    """IRI of each class -> labels of its superclasses (`above`: IRIs of itself and of these)."""
    labels = {
        q.subject.value: q.object.value
        for q in quads
        if q.predicate.value == v.RDFS_LABEL
        and isinstance(q.subject, NamedNode)
        and isinstance(q.object, Literal)
    }
    return {
        iri: frozenset(labels[one] for one in ups if one in labels and one != iri)
        for iri, ups in above.items()
    }


@contextmanager
def _assertions(
    source: str | Path,
    language: str,
    collection: EdgeCollection,
    statistics: DumpStatistics,
    cache: Path | None,
    client: ApiClient | None,
    progress: Progress,
) -> Iterator[Iterator[Edge]]:
    wanted: EdgeFilter = collection.accepts
    if client is None and not str(source).startswith(("http://", "https://")):
        yield read_dump(Path(source), language, wanted, statistics, progress)
        return
    client = client or ApiClient(str(source), ResponseCache(cache) if cache else None)
    client.statistics = statistics
    try:
        yield read_api(client, collection.names, language, wanted, progress)
    finally:
        client.close()
