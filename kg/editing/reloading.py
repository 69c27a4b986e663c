"""An edited ontology taken into a map, wherever the map is and whether or not it is in use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import RdfFormat, serialize

from kg.editing.changes import Change, changes
from kg.editing.imports import load_with_imports
from kg.editing.inspection import refuse_malformed
from kg.editing.sources import ontology_of_map
from kg.editing.taking_in import refuse_partial
from kg.endpoint import is_url
from kg.ontology import Ontology
from kg.semantic_map import SemanticMap
from kg.served import Served
from kg.shapes import Finding
from kg.wire import Json


@dataclass(frozen=True, slots=True)
class Reloaded:
    """What a reload changed: in words, in triples, and under which transaction."""

    changes: tuple[Change, ...]
    kept: tuple[str, ...] = ()  # relations that stand as somebody wrote them into the map
    warnings: tuple[Finding, ...] = ()
    sequence: int = 0
    added: int = 0
    removed: int = 0


def reload(
    address: str,
    source: Path,
    *,
    by: str | None = None,
    whole: bool = False,
    reason: bool = False,
    dry: bool = False,
) -> Reloaded:
    """Check what lies at `source` and make it the ontology of the map at `address`.

    `address` is a map's folder, a SPARQL server with a map, or a running `hereabouts serve`, which
    goes on with the new ontology. A file must bring, or import, all that the map's ontology is made
    of, unless it is `whole`; `reason` asks HermiT too; `dry` changes nothing. Raises OntologyError
    for what is refused (the map is untouched then), GraphError, RemoteError.
    """
    ontology = load_with_imports(source)
    warnings = tuple(refuse_malformed(ontology, reason=reason))
    whole = whole or source.is_dir()
    if dry:
        present = ontology_of_map(address)
        refuse_partial(present.quads, ontology.quads, whole=whole)
        return Reloaded(tuple(changes(present.quads, ontology.quads)), warnings=warnings)
    served = Served.at(address) if is_url(address) else None
    if served is not None:
        return _put(served, ontology, warnings, whole)
    with SemanticMap.open(address) as semantic_map:
        taken = semantic_map.take_ontology(ontology.quads, by=by, whole=whole)
        commit, sequence = taken.commit, semantic_map.sequence
    counts = (len(commit.added), len(commit.removed)) if commit else (0, 0)
    return Reloaded(taken.changes, taken.kept, warnings, sequence, *counts)


def _put(
    served: Served, ontology: Ontology, warnings: tuple[Finding, ...], whole: bool
) -> Reloaded:
    body = serialize([q.triple for q in ontology.quads], format=RdfFormat.N_TRIPLES) or b""

    def read(told: Json) -> Reloaded:
        return Reloaded(
            tuple(Change(**change) for change in told["changes"]),
            tuple(told["kept"]),
            warnings,
            told["sequence"],
            told["added"],
            told["removed"],
        )

    return served.take_ontology(body, read, whole=whole)
