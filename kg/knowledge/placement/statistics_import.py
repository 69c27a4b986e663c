"""Import of room statistics from a table, for an ontology file or a map."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.rooms import RoomType, room_types
from kg.knowledge.placement.statistics import RoomStatistics
from kg.model.errors import InvalidFactError
from kg.model.regular_files import check_regular

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


@dataclass(frozen=True, slots=True)
class _Row:
    room: str
    rooms: int
    object: str
    rooms_with: int


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
        if len(held) >= MAX_ROWS:
            raise _invalid(
                path, line, f"more than {MAX_ROWS:,} rows: kinds of room times of object"
            )
        if rooms.setdefault(row.room, row.rooms) != row.rooms:
            raise _invalid(
                path, line, f"{row.room!r} has {row.rooms} rooms here, {rooms[row.room]} before"
            )
        if (row.room, row.object) in held:
            raise _invalid(path, line, f"{row.object!r} in {row.room!r} occurs twice")
        held[row.room, row.object] = row.rooms_with
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


def _rows(path: Path) -> Iterator[tuple[int, _Row]]:
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
                yield reader.line_num, _row(path, reader.line_num, row)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidFactError(f"{path} is no readable CSV in UTF-8: {reason}") from error


def _row(path: Path, line: int, row: dict[str, str | None]) -> _Row:
    if None in row or any(row[name] is None for name in COLUMNS):
        raise _invalid(path, line, "it has more or fewer fields than the header")
    texts = [" ".join((row[name] or "").split()) for name in COLUMNS]
    for name, text in zip(("room", "object"), (texts[0], texts[2]), strict=True):
        if not text:
            raise _invalid(path, line, f"{name} is empty")
    rooms, rooms_with = (_count(path, line, COLUMNS[i], texts[i]) for i in (1, 3))
    if rooms < 1 or rooms_with > rooms:
        raise _invalid(
            path,
            line,
            f"{rooms_with} of {rooms} rooms hold {texts[2]!r}: rooms_with_object "
            "must be at most n_rooms, and that at least 1",
        )
    return _Row(texts[0], rooms, texts[2], rooms_with)


def _count(path: Path, line: int, column: str, text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 16 and int(text) <= _MAX_COUNT):
        raise _invalid(path, line, f"{column} must be a whole number of at least 0, is {text!r}")
    return int(text)


def _invalid(path: Path, line: int, what: str) -> InvalidFactError:
    return InvalidFactError(f"{path}, line {line}: {what}")
