"""Import closure of an ontology: a file, or a folder of files, and all their imports.

Nothing is fetched. An import is found in ``catalog-v001.xml`` or among the files beside the
importing file (as in Protege), or else among the shipped ontologies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

from pyoxigraph import NamedNode, Quad, Triple

from kg.knowledge.ontology.loading import Ontology, given_files, ontology_files, read_files
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.model.regular_files import read_bytes
from kg.model.resources import ONTOLOGIES
from kg.rdf.parsing import Parse

CATALOG: Final = "catalog-v001.xml"
MAX_CATALOG: Final = 1 << 24  # [bytes]

_ONTOLOGY = NamedNode(v.OWL_ONTOLOGY)
_IMPORTS = NamedNode(v.OWL_IMPORTS)


def load_with_imports(source: Path, parse: Parse | None = None) -> Ontology:
    """The ontology in a file, or in all files of a folder, with its imports.

    Untrusted files, and their neighbours, which are read for their headers, may be parsed in
    another process by `parse` (`kg.serving.workers.updates`).

    Raises:
        OntologyError: there is no ontology, a file does not parse, or an import is not found.
    """
    files = _first(source)
    done: dict[Path, tuple[Quad, ...]] = {}
    while new := [path for path in files if path not in done]:
        for path in new:
            done[path] = read_files([path], parse).quads
        files += [path for path in _imported(done, parse) if path not in files]
    return read_files(files, parse)


def headers(quads: Iterable[Quad]) -> frozenset[str]:
    """IRIs of the ontologies in the quads."""
    return headers_of(quad.triple for quad in quads)


def headers_of(triples: Iterable[Triple]) -> frozenset[str]:
    """IRIs of the ontologies in the triples."""
    return frozenset(
        q.subject.value
        for q in triples
        if q.predicate == v.RDF_TYPE and q.object == _ONTOLOGY and isinstance(q.subject, NamedNode)
    )


def _first(source: Path) -> list[Path]:
    if source.is_dir():
        return given_files(source)
    if not source.exists():
        raise OntologyError(f"no ontology at {source}: neither a file nor a folder is there")
    return [source]


def _imported(read: dict[Path, tuple[Quad, ...]], parse: Parse | None) -> Iterator[Path]:
    """Files of imports that are not read yet."""
    known = {iri for quads in read.values() for iri in headers(quads)}
    for path, quads in tuple(read.items()):
        for quad in quads:
            if quad.predicate == _IMPORTS and isinstance(quad.object, NamedNode):
                wanted = quad.object.value
                if wanted not in known:
                    known.add(wanted)
                    found = _find(wanted, path, parse)
                    if not any(found.samefile(other) for other in read):
                        yield found


def _find(iri: str, importing: Path, parse: Parse | None) -> Path:
    for folder in (importing.parent, ONTOLOGIES):
        listed = _catalog(folder / CATALOG).get(iri)
        if listed is not None and listed.is_file():
            return listed
        for path in ontology_files(folder):
            if path != importing and iri in _headers_of(path, parse):
                return path
    raise OntologyError(
        f"{importing} imports {iri}, which is not at hand; "
        f"put it beside that file, or name its file in {CATALOG}"
    )


def _headers_of(path: Path, parse: Parse | None) -> frozenset[str]:
    try:
        return headers(read_files([path], parse).quads)
    except OntologyError:
        return frozenset()  # a broken neighbour is no import


def _catalog(path: Path) -> dict[str, Path]:
    """IRI to local file, from an OASIS XML catalog; empty without one."""
    if not path.is_file():
        return {}
    try:
        entries = list(ElementTree.fromstring(read_bytes(path, MAX_CATALOG)).iter())
    except OSError as error:
        raise OntologyError(f"{path}: {error.strerror or error}") from None
    except ElementTree.ParseError as error:
        raise OntologyError(f"{path}, line {error.position[0]}: {error}") from None
    found = {}
    for entry in entries:
        name, uri = entry.get("name"), urlsplit(entry.get("uri", ""))
        if entry.tag.endswith("}uri") and name and uri.scheme in ("", "file") and uri.path:
            found[name] = path.parent / unquote(uri.path)
    return found
