"""Questions as data: text, parameters, typed answer and how it is scored; one JSON file of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from kg.model.errors import GraphError
from perception.sources.recording_writer import write_text

FILE: Final = "questions.json"
LICENCE: Final = "CC0-1.0"  # of questions and truth, which are generated
#: family -> type of its answers
FAMILIES: Final[Mapping[str, str]] = {
    "count": "integer",
    "count in place": "integer",
    "presence": "boolean",
    "nearest": "position",
    "within radius": "categories",
    "between": "categories",
    "on or in": "categories",
    "last seen": "time",
    "moved since": "categories",
    "never looked": "status",
    "past": "integer",
    "appeared since": "categories",
    "vanished since": "categories",
    "size": "metres",
    "why": "frame",
    "picture": "crop",
    "unanswerable": "integer or not known",
    "plan": "rooms",
}
#: type -> how it is given in JSON, and how it is scored
TYPES: Final[Mapping[str, str]] = {
    "integer": "a whole number; exact",
    "boolean": "true or false; exact",
    "integer or not known": 'a whole number, or "not known"; exact',
    "metres": "a length in metres; within the tolerance [m]",
    "crop": "[recording, frame, x0, y0, x1, y1]: a box in pixels that overlaps one of those listed "
    "by half (intersection over union)",
    "position": "[x, y] or [x, y, z] in metres; within the tolerance [m] over the floor",
    "categories": "a list of labels; F1 of the sets, those in `ignore` count neither way",
    "time": "seconds since 1970 UTC; within the tolerance [s]",
    "status": "present, gone, looked, none seen, hidden or never looked; exact",
    "frame": "[recording, frame]; one of those listed",
    "rooms": "a list of labels of rooms, the best first; the first is right",
}


@dataclass(frozen=True, slots=True)
class HouseQuestion:
    """A question to the map of one house."""

    id: str
    house: str
    family: str
    text: str
    parameters: Mapping[str, Any]
    answer: Any
    tolerance: float | None = None
    ignore: Sequence[str] = field(default=())  # categories that count neither way

    @property
    def type(self) -> str:
        """The type of the answer."""
        return FAMILIES[self.family]


def save_questions(
    folder: Path, questions: Sequence[HouseQuestion], houses: Mapping[str, Any]
) -> None:
    """Write the questions and what there is of each house."""
    listed = [{**asdict(one), "type": one.type} for one in questions]
    document = {"version": 2, "licence": LICENCE, "types": TYPES, "houses": houses}
    lines = ",\n".join(json.dumps(one, separators=(",", ":")) for one in listed)
    head = json.dumps(document, indent=1).removesuffix("\n}")
    write_text(folder / FILE, f'{head},\n "questions": [\n{lines}\n]}}\n')


def load_questions(folder: Path) -> list[HouseQuestion]:
    """Read what `save_questions` wrote; raises GraphError for anything else."""
    document = read_json(folder / FILE)
    try:
        entries = [dict(entry) for entry in document["questions"]]
        for entry in entries:
            entry.pop("type", None)
        found = [HouseQuestion(**entry) for entry in entries]
    except (KeyError, TypeError) as error:
        raise GraphError(f"{folder / FILE} holds no questions: {error!r}") from error
    unknown = {one.family for one in found} - FAMILIES.keys()
    if unknown:
        raise GraphError(f"unknown families {sorted(unknown)}; there are: {', '.join(FAMILIES)}")
    return found


def read_json(path: Path) -> Any:
    """The content of a JSON file; raises GraphError where it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise GraphError(f"cannot read {path}: {error}") from error
