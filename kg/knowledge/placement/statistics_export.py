"""Export of room statistics: quads of an ontology, and an ontology file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, serialize

from kg.knowledge.placement.rooms import RoomType
from kg.knowledge.placement.statistics import statistics, statistics_quads
from kg.knowledge.placement.statistics_import import RoomTable
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError, OntologyError
from kg.rdf.parsing import parse_file
from kg.store.atomic_file import write_atomically

#: the ontologies with the categories of the statistics
_IMPORTS: Final = tuple(v.ROOMS_ONTOLOGY.replace("rooms/", name) for name in ("objects", "places"))


def room_type_quads(types: Iterable[RoomType]) -> Iterator[Quad]:
    """The quads of graph:ontology that declare new place categories."""
    for kind in sorted(types, key=lambda kind: kind.iri):
        properties: dict[str, NamedNode | Literal] = {
            v.RDF_TYPE.value: NamedNode(v.OWL_CLASS),
            v.RDFS_SUB_CLASS_OF: NamedNode(kind.below or v.PLACE),
            v.RDFS_LABEL: Literal(kind.label),
            v.RDFS_COMMENT: Literal("A kind of room that statistics of real rooms tell apart."),
        }
        for predicate, value in properties.items():
            yield Quad(NamedNode(kind.iri), NamedNode(predicate), value, v.ONTOLOGY_GRAPH)


def table_quads(table: RoomTable) -> tuple[Quad, ...]:
    """Quads of graph:ontology for a table of rooms."""
    return (*room_type_quads(table.new_types), *statistics_quads(table.statistics))


def write_rooms(table: RoomTable, path: Path) -> None:
    """Write a Turtle file for a folder of ontologies; the same table gives the same bytes.

    Raises:
        GraphError: the file cannot be written.
        InvalidFactError: the file exists and has other content than this source's statistics.
    """
    source, license = table.statistics[0].source, table.statistics[0].license
    name = NamedNode(v.ROOMS_ONTOLOGY + quote(source, safe=""))
    _check_overwritable(path, name, source)
    properties: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, NamedNode(v.OWL_ONTOLOGY)),
        *((v.OWL_IMPORTS, NamedNode(iri)) for iri in _IMPORTS),
        (v.RDFS_LABEL, Literal(f"room statistics: {source}")),
        (v.RDFS_COMMENT, Literal("How many real rooms of a kind hold an object of a kind.")),
        (v.OWL_VERSION_INFO, Literal("1")),
        (v.DCT_LICENSE, NamedNode(license) if license else Literal("not stated")),
    ]
    header = [
        Quad(name, NamedNode(predicate), value, v.ONTOLOGY_GRAPH) for predicate, value in properties
    ]
    triples = [quad.triple for quad in (*header, *table_quads(table))]
    text = serialize(triples, format=RdfFormat.TURTLE, prefixes=_PREFIXES) or b""
    lines = text.decode().split("\n")[:-1]
    # the serialiser declares prefixes in a random order
    lines.sort(key=lambda line: line if line.startswith("@prefix") else "@prefiy")
    write_atomically(path, "\n".join(lines) + "\n")


def _check_overwritable(path: Path, name: NamedNode, source: str) -> None:
    if not path.exists():
        return
    try:
        triples = [quad.triple for quad in parse_file(path)]
        own = {one.iri for one in statistics(parse_file(path)) if one.source == source}
    except OntologyError as error:
        raise InvalidFactError(f"{error}; name a new file, the import would overwrite it") from None
    for triple in triples:
        subject = getattr(triple.subject, "value", "")
        kind = subject.startswith(v.ROOM_TYPE) and triple.predicate.value in _OF_KINDS
        if triple.subject != name and subject not in own and not kind:
            raise InvalidFactError(
                f"{path} holds more than room statistics of {source!r} ({triple.subject} "
                f"{triple.predicate}): name a new file, the import would overwrite this one"
            )


#: predicates of a room type that statistics declare
_OF_KINDS: Final = (v.RDF_TYPE.value, v.RDFS_SUB_CLASS_OF, v.RDFS_LABEL, v.RDFS_COMMENT)
_PREFIXES: Final = {name: v.PREFIXES[name] for name in ("here", "owl", "rdfs", "dct", "xsd")}
