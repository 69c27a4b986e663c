"""Label table: a user's mapping of network labels to categories, CSV of label and category."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key
from kg.model.errors import LabelsError, UnknownCategoryError
from kg.model.regular_files import read_text

IGNORED: Final = ("", "-")  # categories of labels to be ignored
_HEADER: Final = ["label", "category"]


@dataclass(frozen=True, slots=True)
class LabelTable:
    """Label table, by normalised label: the name of a category, or None to ignore the label."""

    names: Mapping[str, str | None] = field(default_factory=dict)

    def ignores(self, label: str) -> bool:
        """Whether the label is to be ignored."""
        return self.names.get(name_key(label), "") is None

    def category(self, label: str, kind: str, catalogue: Catalogue) -> Category | None:
        """Category of that kind for the label; None where the table has none."""
        name = self.names.get(name_key(label))
        return None if name is None else catalogue.get(name, kind)

    def check_categories(self, catalogue: Catalogue) -> None:
        """Raises LabelsError where the table names an unknown category."""
        for name in filter(None, self.names.values()):
            if not (catalogue.get(name, "object") or catalogue.get(name, "place")):
                try:
                    catalogue.find(name, "object")
                except UnknownCategoryError as error:
                    raise LabelsError(f"the labels map is refused: {error}") from error


def load_label_table(path: Path) -> LabelTable:
    """Read a table: `label,category` a line, category empty or "-" to ignore the label.

    A header line and lines that begin with "#" may be there. Categories are called by label,
    synonym or IRI. Raises LabelsError for anything else, and for a label given twice.
    """
    names: dict[str, str | None] = {}
    for number, row in _rows(path):
        if len(row) != 2 or not row[0]:
            raise LabelsError(
                f"{path}, line {number}: expected label,category, got {','.join(row)!r}"
            )
        key, name = name_key(row[0]), None if row[1] in IGNORED else row[1]
        if names.get(key, name) != name:
            raise LabelsError(f"{path}, line {number}: {row[0]!r} is given two categories")
        names[key] = name
    if not names:
        raise LabelsError(f"{path} maps no label: write lines of label,category")
    return LabelTable(names)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Lines of cells, with their numbers, without header, comments and empty lines."""
    try:
        text = io.StringIO(read_text(path, "utf-8-sig"), newline="")
        reader = csv.reader(text, strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except OSError as error:
        raise LabelsError(f"cannot read the labels map {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise LabelsError(f"the labels map {path} is no CSV in UTF-8: {error}") from error
    rows = [(n, row) for n, row in rows if any(row) and not row[0].startswith("#")]
    return rows[1:] if rows and [c.lower() for c in rows[0][1]] == _HEADER else rows
