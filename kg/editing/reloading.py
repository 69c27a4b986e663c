"""An edited ontology taken into a map, wherever the map is and whether or not it is in use."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import requests
from pyoxigraph import RdfFormat, serialize

from kg import vocabulary as v
from kg.editing.changes import Change, changes
from kg.editing.imports import load_with_imports
from kg.editing.inspection import refuse_malformed
from kg.editing.sources import ontology_of_map
from kg.editing.taking_in import refuse_partial
from kg.endpoint import TOKEN_VARIABLE, is_url
from kg.errors import OntologyError, RemoteError, UnreachableError
from kg.ontology import Ontology
from kg.semantic_map import SemanticMap
from kg.shapes import Finding

_N_TRIPLES: Final = "application/n-triples"
_WITHIN: Final = (5.0, 300.0)  # [s] to connect, to answer


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
    if is_url(address) and is_served(address):
        return _put(address, ontology, warnings, whole)
    with SemanticMap.open(address) as semantic_map:
        taken = semantic_map.take_ontology(ontology.quads, by=by, whole=whole)
        commit, sequence = taken.commit, semantic_map.sequence
    counts = (len(commit.added), len(commit.removed)) if commit else (0, 0)
    return Reloaded(taken.changes, taken.kept, warnings, sequence, *counts)


def is_served(url: str) -> bool:
    """Whether a `hereabouts serve` answers there, and not just any SPARQL server."""
    try:
        answer = requests.get(f"{url.rstrip('/')}/health", timeout=_WITHIN)
        told = answer.json() if answer.ok else None
    except (requests.RequestException, ValueError):
        return False
    return isinstance(told, dict) and {"base", "sequence"} <= told.keys()


def _put(url: str, ontology: Ontology, warnings: tuple[Finding, ...], whole: bool) -> Reloaded:
    body = serialize([q.triple for q in ontology.quads], format=RdfFormat.N_TRIPLES) or b""
    headers = {"Content-Type": _N_TRIPLES, "Accept": "application/json"}
    if token := os.environ.get(TOKEN_VARIABLE):
        headers["Authorization"] = f"Bearer {token}"
    name = v.ONTOLOGY_GRAPH.removeprefix(v.GRAPH)
    try:
        answer = requests.put(
            f"{url.rstrip('/')}/graphs/{name}{'?whole=true' if whole else ''}",
            data=body,
            headers=headers,
            timeout=_WITHIN,
        )
        told = answer.json()
    except requests.RequestException as error:
        raise UnreachableError(f"{url} does not answer: {type(error).__name__}") from error
    except ValueError as error:
        raise RemoteError(f"{url} answered no JSON, with status {answer.status_code}") from error
    if not answer.ok:
        raise _refusal(url, answer.status_code, told)
    return Reloaded(
        tuple(Change(**change) for change in told["changes"]),
        tuple(told["kept"]),
        warnings,
        told["sequence"],
        told["added"],
        told["removed"],
    )


def _refusal(url: str, status: int, told: Any) -> OntologyError | RemoteError:
    detail = str(told.get("detail", "")) if isinstance(told, dict) else ""
    if status == 422:
        return OntologyError(detail)
    hint = f"; set {TOKEN_VARIABLE}" if status == 401 else ""
    return RemoteError(f"{url} refused the ontology ({status}): {detail}{hint}")
