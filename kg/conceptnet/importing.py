"""An import from beginning to end: source, facts, relations, file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from kg.categories import Catalogue
from kg.conceptnet.api import Client, read_api
from kg.conceptnet.assertion import Assertion
from kg.conceptnet.cache import Cache
from kg.conceptnet.collecting import Collection
from kg.conceptnet.dump import Progress, Reading, Wanted, read_dump
from kg.conceptnet.edits import Change, Standing, merge, read_standing, write_text
from kg.conceptnet.names import Names
from kg.conceptnet.relate import Found, relate
from kg.errors import ConceptNetError
from kg.ontology import load_ontologies, superclasses
from kg.shipped import ONTOLOGIES

PUBLIC_API: Final = "http://api.conceptnet.io"


@dataclass(frozen=True, slots=True)
class Imported:
    """What an import found, and what it changed."""

    found: tuple[Found, ...]  # all relations the source supports
    changes: tuple[Change, ...]  # to the file, or to an empty one
    written: bool  # whether the file is other than it was
    used: int  # assertions that speak of our categories
    weak: int  # relations with too little for them, or too much against
    lines: int  # lines of the file, or edges of the answers
    requests: int  # to the web API; what the cache knew is not among them
    skipped: Counter[str]  # lines or edges that hold no assertion, by reason


def _silent(done: int, total: int) -> None:
    """Progress nobody watches."""


def import_conceptnet(
    source: str | Path,
    into: Path | None = None,
    *,
    language: str = "en",
    ontologies: Path = ONTOLOGIES,
    dry_run: bool = False,
    cache: Path | None = None,
    client: Client | None = None,
    progress: Progress = _silent,
) -> Imported:
    """Regenerate what ConceptNet says of the categories of an ontology.

    Args:
        source: file (ConceptNet 5 TSV or ConceptNet 4 graph, plain or gzip), or the address of a
            web API, such as `PUBLIC_API`.
        into: the Turtle file to write; an earlier import's is brought up to date, with what people
            did to it left as it is. None: nothing is written.
        language: whose assertions, as ConceptNet names it.
        ontologies: folder of the ontologies that hold the categories; `into` is not read there.
        dry_run: work everything out, and write nothing.
        cache: folder for answers of the web API; an import that broke off goes on from there.
        client: the web API as already set up, in place of `source`'s address.
        progress: told how many bytes (or requests) are done, of how many.

    Raises:
        ConceptNetError: the source cannot be read, the file cannot be brought up to date, or
            would be emptied, since nothing in the source speaks of the categories.
        OntologyError: the ontologies cannot be read.
    """
    standing = Standing() if into is None else read_standing(into)
    quads = load_ontologies(ontologies, without=into).quads
    catalogue = Catalogue.from_quads(quads)
    kinds = {c.iri for c in catalogue.categories if c.kind == "supercategory"}
    groups = {
        iri: tuple(one for one in above if one in kinds)
        for iri, above in superclasses(quads).items()
    }
    collection = Collection(Names(catalogue))
    reading = Reading()
    with _assertions(source, language, collection, reading, cache, client, progress) as assertions:
        used = collection.take(assertions)
    if not used and into is not None:  # it would empty the file
        raise ConceptNetError(
            f"{source} says nothing of these categories in the language {language!r} "
            f"({reading.lines} assertions read): ConceptNet calls English 'en', German 'de'"
        )
    found, weak = relate(collection, groups)
    text, changes = merge(standing, found)
    written = into is not None and not dry_run and write_text(into, text)
    return Imported(
        *(found, tuple(changes), written, used, weak),
        *(reading.lines, reading.requests, reading.skipped),
    )


@contextmanager
def _assertions(
    source: str | Path,
    language: str,
    collection: Collection,
    reading: Reading,
    cache: Path | None,
    client: Client | None,
    progress: Progress,
) -> Iterator[Iterator[Assertion]]:
    wanted: Wanted = collection.wants
    if client is None and not str(source).startswith(("http://", "https://")):
        yield read_dump(Path(source), language, wanted, reading, progress)
        return
    client = client or Client(str(source), Cache(cache) if cache else None)
    client.reading = reading
    try:
        yield read_api(client, collection.names, language, wanted, progress)
    finally:
        client.close()
