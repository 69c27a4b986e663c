"""ConceptNet import: reads a source, aggregates relations, merges them into a file.

The review table lists the relations of an import, one a row, and a person drops the wrong ones. It
is a CSV file for a spreadsheet, the weakest first. `keep` is yes or no (or yours,
of a relation that was edited by hand in the imported file). A relation with no is removed from the
imported file and stays removed at later imports, as one that a person removes by hand. One that
becomes yes again is brought back; `kept` says what `keep` was when the table was written, so that
an old table does not bring back what was removed in the file since.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.conceptnet.collecting import EdgeCollection
from kg.knowledge.conceptnet.edges import Edge, EdgeFilter
from kg.knowledge.conceptnet.names import TermMatcher
from kg.knowledge.conceptnet.reading import (
    ApiClient,
    DumpStatistics,
    Progress,
    ResponseCache,
    read_api,
    read_dump,
)
from kg.knowledge.conceptnet.relate import ImportedRelation, relate
from kg.knowledge.conceptnet.turtle import (
    ImportedFile,
    RelationChange,
    full_iri,
    merge,
    prefixed,
    read_imported_file,
)
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies, superclasses
from kg.knowledge.ontology.relations import Key
from kg.model import vocabulary as v
from kg.model.errors import ConceptNetError
from kg.model.resources import ONTOLOGIES
from kg.store.folder import write_atomically

COLUMNS: Final = (
    *("keep", "kept", "subject", "relation", "object", "probability", "weight", "against"),
    *("sentences", "sources"),
)
_KEY: Final = ("subject", "relation", "object")


def read_review(path: Path) -> dict[Key, bool]:
    """Key of each relation that a table drops (False) or brings back (True).

    Raises:
        ConceptNetError: the file is no such table, or a `keep` has another value.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise ConceptNetError(f"{path}: {error}") from None
    # spreadsheets of some countries separate columns by semicolons
    first = text.partition("\n")[0]
    rows = csv.DictReader(io.StringIO(text), delimiter=max(",;\t", key=first.count))
    if missing := {"keep", *_KEY} - set(rows.fieldnames or ()):
        raise ConceptNetError(
            f"{path} is no review table: it has no column {', '.join(sorted(missing))}; "
            "name a new file, and the import writes one"
        )
    decisions: dict[Key, bool] = {}
    for row in rows:
        keep = (row["keep"] or "").strip().casefold()
        if keep not in ("yes", "no", "yours"):
            raise ConceptNetError(
                f"{path}, line {rows.line_num}: keep is {keep!r}; yes or no would work"
            )
        subject, kind, target = (full_iri((row[name] or "").strip()) for name in _KEY)
        if keep == "no" or (keep == "yes" and row.get("kept") == "no"):
            decisions[kind, subject, target] = keep == "yes"
    return decisions


def apply_review(file: ImportedFile, decisions: dict[Key, bool]) -> None:
    """Make the decisions of a review those of the person who edits the imported file.

    Raises:
        ConceptNetError: a relation that was edited by hand is to be dropped.
    """
    for key, keep in decisions.items():
        if keep:
            file.listed -= {key} - set(file.imported)
        elif key in file.edited_by_people:
            kind, subject, target = map(prefixed, key)
            raise ConceptNetError(
                f"{subject} {kind} {target} was edited by hand, so the review cannot drop it; "
                "remove it in the imported file"
            )
        else:
            file.listed.add(key)
            file.imported.pop(key, None)


def review_text(found: Iterable[ImportedRelation], file: ImportedFile) -> str:
    """The table of all relations of an import; those that people removed have keep = no."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    removed = file.removed
    for relation in sorted(found, key=lambda one: (one.weight - one.weight_against, one.key)):
        kind, subject, target = relation.key
        keep = "no" if relation.key in removed else "yes"
        keep = "yours" if relation.key in file.edited_by_people else keep
        table.writerow(
            [
                *(keep, keep),
                *(prefixed(iri) for iri in (subject, kind, target)),
                "" if relation.probability is None else relation.probability,
                *(relation.weight, relation.weight_against),
                *(" | ".join(relation.surfaces), " ".join(relation.sources)),
            ]
        )
    return out.getvalue()


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
