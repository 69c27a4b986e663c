"""Room statistics into an ontology file, or into the ontology of a map."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, serialize

from kg import vocabulary as v
from kg.commits import Cause
from kg.errors import InvalidFactError, OntologyError
from kg.export import write_atomically
from kg.ontology import compile_commonsense
from kg.placement.imports import RoomTable
from kg.placement.rooms import RoomType
from kg.placement.statistics import statistics, statistics_quads
from kg.semantic_map import SemanticMap
from kg.syntaxes import parse_file

_ONTOLOGY: Final = NamedNode(v.ONTOLOGY_GRAPH)
_COMMONSENSE: Final = NamedNode(v.COMMONSENSE_GRAPH)
#: the ontologies whose categories the statistics are about
_IMPORTS: Final = tuple(v.ROOMS_ONTOLOGY.replace("rooms/", name) for name in ("objects", "places"))


def room_type_quads(types: Iterable[RoomType]) -> Iterator[Quad]:
    """The quads of graph:ontology that declare new place categories."""
    for kind in sorted(types, key=lambda kind: kind.iri):
        said: dict[str, NamedNode | Literal] = {
            v.RDF_TYPE: NamedNode(v.OWL_CLASS),
            v.RDFS_SUB_CLASS_OF: NamedNode(kind.below or v.PLACE),
            v.RDFS_LABEL: Literal(kind.label),
            v.RDFS_COMMENT: Literal("A kind of room that statistics of real rooms tell apart."),
        }
        for predicate, value in said.items():
            yield Quad(NamedNode(kind.iri), NamedNode(predicate), value, _ONTOLOGY)


def table_quads(table: RoomTable) -> tuple[Quad, ...]:
    """All quads of graph:ontology a table of rooms comes to."""
    return (*room_type_quads(table.new_types), *statistics_quads(table.statistics))


def write_rooms(table: RoomTable, path: Path) -> None:
    """A Turtle file for a folder of ontologies; the same table gives the same bytes.

    Raises GraphError where it cannot be written, InvalidFactError where a file is there that says
    something else than such a table of the same source: it would be lost.
    """
    source = table.statistics[0].source
    name = NamedNode(v.ROOMS_ONTOLOGY + quote(source, safe=""))
    _refuse_others(path, name, source)
    said: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE, NamedNode(v.OWL_ONTOLOGY)),
        *((v.OWL_IMPORTS, NamedNode(iri)) for iri in _IMPORTS),
        (v.RDFS_LABEL, Literal(f"room statistics: {source}")),
        (v.RDFS_COMMENT, Literal("How many real rooms of a kind hold an object of a kind.")),
        (v.OWL_VERSION_INFO, Literal("1")),
        (v.DCT_LICENSE, _license(table)),
    ]
    header = [Quad(name, NamedNode(predicate), value, _ONTOLOGY) for predicate, value in said]
    triples = [quad.triple for quad in (*header, *table_quads(table))]
    text = serialize(triples, format=RdfFormat.TURTLE, prefixes=_PREFIXES) or b""
    lines = text.decode().split("\n")[:-1]
    # the serialiser declares prefixes in an order of its own, another one each time
    lines.sort(key=lambda line: line if line.startswith("@prefix") else "@prefiy")
    write_atomically(path, "\n".join(lines) + "\n")


def _refuse_others(path: Path, name: NamedNode, source: str) -> None:
    if not path.exists():
        return
    try:
        triples = [quad.triple for quad in parse_file(path)]
        ours = {one.iri for one in statistics(parse_file(path)) if one.source == source}
    except OntologyError as error:
        raise InvalidFactError(f"{error}; name a new file, the import would overwrite it") from None
    for triple in triples:
        subject = getattr(triple.subject, "value", "")
        kind = subject.startswith(v.ROOM_TYPE) and triple.predicate.value in _OF_KINDS
        if triple.subject != name and subject not in ours and not kind:
            raise InvalidFactError(
                f"{path} holds more than room statistics of {source!r} ({triple.subject} "
                f"{triple.predicate}): name a new file, the import would overwrite this one"
            )


#: what is said of a kind of room that statistics bring
_OF_KINDS: Final = (v.RDF_TYPE, v.RDFS_SUB_CLASS_OF, v.RDFS_LABEL, v.RDFS_COMMENT)
_PREFIXES: Final = {name: v.PREFIXES[name] for name in ("here", "owl", "rdfs", "dct", "xsd")}


def _license(table: RoomTable) -> NamedNode | Literal:
    given = table.statistics[0].license
    return NamedNode(given) if given else Literal("not stated")


def import_rooms(semantic_map: SemanticMap, table: RoomTable, by: str = "import rooms") -> int:
    """Put the statistics of a table into a map's ontology; returns how many triples changed.

    What the map had of the same source is replaced. One transaction; importing twice changes
    nothing the second time.
    """
    sources = {one.source for one in table.statistics}
    with semantic_map.hold():
        stored = tuple(semantic_map.engine.quads_for_pattern(None, None, None, _ONTOLOGY))
        old = [one for one in statistics(stored) if one.source in sources]
        wanted = set(table_quads(table))
        gone = set(statistics_quads(old)) - wanted
        ontology = [q for q in stored if q not in gone]
        compiled = set(compile_commonsense([*ontology, *wanted]))
        compiled -= set(semantic_map.engine.quads_for_pattern(None, None, None, _COMMONSENSE))
        cause = Cause("import", by, "; ".join(sorted(sources)))
        change = semantic_map.store.commit(
            sorted(gone, key=str), sorted(wanted | compiled, key=str), cause
        )
        semantic_map.reread_ontology()  # new kinds of rooms are categories from now on
    return len(change) if change else 0
