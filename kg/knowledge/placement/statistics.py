"""Room statistics: how many rooms of a kind were searched, and how many held an object.

They are imported from a table and exported as quads of an ontology or as an ontology file.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, serialize

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.surveys import RoomType, room_types
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError, OntologyError
from kg.model.regular_files import check_regular
from kg.rdf.literals import subject_quads
from kg.rdf.parsing import parse_file
from kg.store.folder import write_atomically

_CLASS: Final = NamedNode(v.ROOM_STATISTICS)


@dataclass(frozen=True, slots=True, order=True)
class RoomStatistics:
    """Room statistics of one pair: of `rooms` rooms, `rooms_with` held the object."""

    source: str  # name of the data set
    place: str  # IRI of the kind of place
    object: str  # IRI of the kind of object
    rooms: int  # >= 1
    rooms_with: int  # 0..rooms
    license: str = ""  # IRI of the licence of the counts; "": unknown

    @property
    def iri(self) -> str:
        """The IRI of the node in graph:ontology."""
        return "/".join((v.STATISTICS + _name(self.source), _name(self.place), _name(self.object)))


def _name(text: str) -> str:
    return quote(text.removeprefix(v.HERE).removeprefix(v.ROOM_TYPE), safe="")


def statistics_quads(found: Iterable[RoomStatistics]) -> Iterator[Quad]:
    """Quads of graph:ontology for room statistics."""
    for one in found:
        facts: list[tuple[str, NamedNode | Literal]] = [
            (v.RDF_TYPE.value, _CLASS),
            (v.STATISTICS_OBJECT, NamedNode(one.object)),
            (v.STATISTICS_PLACE, NamedNode(one.place)),
            (v.ROOM_COUNT, Literal(one.rooms)),
            (v.ROOMS_WITH_OBJECT, Literal(one.rooms_with)),
            (v.DCT_SOURCE, Literal(one.source)),
        ]
        if one.license:
            facts.append((v.DCT_LICENSE, NamedNode(one.license)))
        yield from subject_quads(one.iri, facts, v.ONTOLOGY_GRAPH)


def statistics(quads: Iterable[Quad]) -> tuple[RoomStatistics, ...]:
    """The statistics in an ontology's quads, sorted.

    Raises:
        OntologyError: a node lacks a part, or has more rooms with the object than rooms.
    """
    properties: dict[object, dict[str, str]] = defaultdict(dict)
    nodes: dict[object, None] = {}
    for q in quads:
        if q.predicate == v.RDF_TYPE and q.object == _CLASS:
            nodes[q.subject] = None
        elif isinstance(q.object, NamedNode | Literal) and q.predicate.value in _PARTS:
            properties[q.subject][q.predicate.value] = q.object.value
    return tuple(sorted(_statistics(node, properties[node]) for node in nodes))


_PARTS: Final = frozenset(
    {
        *(v.STATISTICS_OBJECT, v.STATISTICS_PLACE, v.ROOM_COUNT, v.ROOMS_WITH_OBJECT),
        *(v.DCT_SOURCE, v.DCT_LICENSE),
    }
)


def _statistics(node: object, properties: dict[str, str]) -> RoomStatistics:
    try:
        one = RoomStatistics(
            properties.get(v.DCT_SOURCE, "unknown"),
            properties[v.STATISTICS_PLACE],
            properties[v.STATISTICS_OBJECT],
            int(properties[v.ROOM_COUNT]),
            int(properties[v.ROOMS_WITH_OBJECT]),
            properties.get(v.DCT_LICENSE, ""),
        )
    except (KeyError, ValueError) as error:
        raise OntologyError(
            f"{node} needs a here:statisticsObject, a here:statisticsPlace, and integers "
            f"here:roomCount and here:roomsWithObject ({error})"
        ) from None
    if not 0 <= one.rooms_with <= one.rooms or one.rooms < 1:
        raise OntologyError(
            f"{node} needs 1 or more here:roomCount and no more here:roomsWithObject than that, "
            f"has {one.rooms} and {one.rooms_with}"
        )
    return one


def is_iri(text: str) -> bool:
    """Whether a text is an absolute IRI."""
    try:
        NamedNode(text)
    except ValueError:
        return False
    return ":" in text


COLUMNS: Final = ("room", "n_rooms", "object", "rooms_with_object")
#: shipped tables by name: file, source, licence
SHIPPED: Final = {
    "s3dis": (
        Path(__file__).with_name("tables") / "s3dis.csv",
        "S3DIS",
        "https://www.apache.org/licenses/LICENSE-2.0",
    )
}
_MAX_COUNT: Final = 10**12
#: a data set has at most hundreds of kinds of rooms and of objects
MAX_ROWS: Final = 200_000


@dataclass(frozen=True, slots=True)
class RoomTable:
    """Room table: its statistics, its new room types, and its omitted names."""

    statistics: tuple[RoomStatistics, ...]
    new_types: tuple[RoomType, ...]  # place categories that do not exist yet
    mixed: tuple[str, ...]  # omitted names of rooms of several kinds or of none
    unknown: tuple[str, ...]  # omitted names of objects without a category


def read_rooms(path: Path, catalogue: Catalogue, source: str, license: str = "") -> RoomTable:
    """The statistics in a CSV file with the columns room, n_rooms, object, rooms_with_object.

    Other columns are ignored. Each room name has one n_rooms. The counts of names of the same
    category ("hallway" and "hall/stairwell") are added up.

    Raises:
        InvalidFactError: a column is missing, a number is invalid, a pair occurs twice, a room has
            two different n_rooms (the message has the line), or no row is usable.
    """
    rooms: dict[str, int] = {}
    held: dict[tuple[str, str], int] = {}
    for line, row in _rows(path):
        try:
            _count_row(row, rooms, held)
        except ValueError as error:
            raise InvalidFactError(f"{path}, line {line}: {error}") from None
    return _table(path, rooms, held, catalogue, RoomStatistics(source, "", "", 1, 0, license))


def _table(
    path: Path,
    rooms: dict[str, int],
    held: dict[tuple[str, str], int],
    catalogue: Catalogue,
    pattern: RoomStatistics,
) -> RoomTable:
    types = {name: room_types(name, catalogue) for name in rooms}
    single = {name: kinds[0] for name, kinds in types.items() if len(kinds) == 1}
    objects = {name: catalogue.get(name, "object") for _, name in held}
    number: dict[str, int] = defaultdict(int)
    for name, kind in single.items():
        number[kind.iri] += rooms[name]
    found: dict[tuple[str, str], int] = defaultdict(int)
    for (room, name), rooms_with in held.items():
        if room in single and (category := objects[name]) is not None:
            found[single[room].iri, category.iri] += rooms_with
    for place in {place for place, _ in found}:
        # one room may hold two names of the same object
        for key in [key for key in found if key[0] == place and found[key] > number[place]]:
            found[key] = number[place]
    if not found:
        raise InvalidFactError(f"{path}: no room and object that the ontology knows")
    # rooms without objects count too: a row for each of their types
    anything = min(thing for _, thing in found)
    for place in set(number) - {place for place, _ in found}:
        found[place, anything] = 0
    return RoomTable(
        tuple(
            replace(pattern, place=place, object=thing, rooms=number[place], rooms_with=count)
            for (place, thing), count in sorted(found.items())
        ),
        tuple(sorted({k for k in single.values() if k.below}, key=lambda kind: kind.iri)),
        tuple(sorted(set(rooms) - set(single))),
        tuple(sorted(name for name, category in objects.items() if category is None)),
    )


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str | None]]]:
    try:
        check_regular(path)
        # spreadsheets write a byte order mark
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, strict=True)
            columns = reader.fieldnames or ()
            if missing := [name for name in COLUMNS if name not in columns]:
                raise InvalidFactError(
                    f"{path} has no column {', '.join(missing)}; it needs {', '.join(COLUMNS)}, "
                    f"has {', '.join(map(repr, columns[:8])) or 'none'}"
                )
            for row in reader:
                yield reader.line_num, row
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidFactError(f"{path} is no readable CSV in UTF-8: {reason}") from error


def _count_row(
    row: dict[str, str | None], rooms: dict[str, int], held: dict[tuple[str, str], int]
) -> None:
    """Add a row to the numbers of rooms, and of rooms with an object.

    Raises ValueError, which says what is wrong with the row.
    """
    if len(held) >= MAX_ROWS:
        raise ValueError(f"more than {MAX_ROWS:,} rows: kinds of room times of object")
    if None in row or any(row[name] is None for name in COLUMNS):
        raise ValueError("it has more or fewer fields than the header")
    texts = {name: " ".join((row[name] or "").split()) for name in COLUMNS}
    room, thing = texts["room"], texts["object"]
    for name, text in (("room", room), ("object", thing)):
        if not text:
            raise ValueError(f"{name} is empty")
    number, rooms_with = (_count(name, texts[name]) for name in ("n_rooms", "rooms_with_object"))
    if number < 1 or rooms_with > number:
        raise ValueError(
            f"{rooms_with} of {number} rooms hold {thing!r}: rooms_with_object must be at most "
            "n_rooms, and that at least 1"
        )
    if rooms.setdefault(room, number) != number:
        raise ValueError(f"{room!r} has {number} rooms here, {rooms[room]} before")
    if (room, thing) in held:
        raise ValueError(f"{thing!r} in {room!r} occurs twice")
    held[room, thing] = rooms_with


def _count(column: str, text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 16 and int(text) <= _MAX_COUNT):
        raise ValueError(f"{column} must be a whole number of at least 0, is {text!r}")
    return int(text)


#: the ontologies with the categories of the statistics
_IMPORTS: Final = tuple(v.ROOMS_ONTOLOGY.replace("rooms/", name) for name in ("objects", "places"))


def room_type_quads(types: Iterable[RoomType]) -> Iterator[Quad]:
    """The quads of graph:ontology that declare new place categories."""
    for kind in sorted(types, key=lambda kind: kind.iri):
        facts: list[tuple[str, NamedNode | Literal]] = [
            (v.RDF_TYPE.value, NamedNode(v.OWL_CLASS)),
            (v.RDFS_SUB_CLASS_OF, NamedNode(kind.below or v.PLACE)),
            (v.RDFS_LABEL, Literal(kind.label)),
            (v.RDFS_COMMENT, Literal("A kind of room that statistics of real rooms tell apart.")),
        ]
        yield from subject_quads(kind.iri, facts, v.ONTOLOGY_GRAPH)


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
    header = subject_quads(name.value, properties, v.ONTOLOGY_GRAPH)
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
