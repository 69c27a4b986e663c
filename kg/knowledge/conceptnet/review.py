"""Review table: the relations of an import, one a row, in which a person drops the wrong ones.

The table is a CSV file for a spreadsheet, the weakest first. `keep` is yes or no (or yours,
of a relation that was edited by hand in the imported file). A relation with no is removed from the
imported file and stays removed at later imports, as one that a person removes by hand. One that
becomes yes again is brought back; `kept` says what `keep` was when the table was written, so that
an old table does not bring back what was removed in the file since.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from kg.knowledge.conceptnet.relate import ImportedRelation
from kg.knowledge.conceptnet.turtle import ImportedFile, full_iri, prefixed
from kg.knowledge.ontology.relations import Key
from kg.model.errors import ConceptNetError

COLUMNS: Final = (
    *("keep", "kept", "subject", "relation", "object", "probability", "weight", "against"),
    *("sentences", "sources"),
)
_KEY: Final = ("subject", "relation", "object")


def read_review(path: Path) -> dict[Key, bool]:
    """Key of each relation that a table drops (False) or brings back (True).

    Raises:
        ConceptNetError: the file is no such table, or a `keep` has another value.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise ConceptNetError(f"{path}: {error}") from None
    # spreadsheets of some countries separate columns by semicolons
    first = text.partition("\n")[0]
    rows = csv.DictReader(io.StringIO(text), delimiter=max(",;\t", key=first.count))
    if missing := {"keep", *_KEY} - set(rows.fieldnames or ()):
        raise ConceptNetError(
            f"{path} is no review table: it has no column {', '.join(sorted(missing))}; "
            "name a new file, and the import writes one"
        )
    decisions: dict[Key, bool] = {}
    for row in rows:
        keep = (row["keep"] or "").strip().casefold()
        if keep not in ("yes", "no", "yours"):
            raise ConceptNetError(
                f"{path}, line {rows.line_num}: keep is {keep!r}; yes or no would work"
            )
        subject, kind, target = (full_iri((row[name] or "").strip()) for name in _KEY)
        if keep == "no" or (keep == "yes" and row.get("kept") == "no"):
            decisions[kind, subject, target] = keep == "yes"
    return decisions


def apply_review(file: ImportedFile, decisions: dict[Key, bool]) -> None:
    """Make the decisions of a review those of the person who edits the imported file.

    Raises:
        ConceptNetError: a relation that was edited by hand is to be dropped.
    """
    for key, keep in decisions.items():
        if keep:
            file.listed -= {key} - set(file.imported)
        elif key in file.edited_by_people:
            kind, subject, target = map(prefixed, key)
            raise ConceptNetError(
                f"{subject} {kind} {target} was edited by hand, so the review cannot drop it; "
                "remove it in the imported file"
            )
        else:
            file.listed.add(key)
            file.imported.pop(key, None)


def review_text(found: Iterable[ImportedRelation], file: ImportedFile) -> str:
    """The table of all relations of an import; those that people removed have keep = no."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    removed = file.removed
    for relation in sorted(found, key=lambda one: (one.weight - one.weight_against, one.key)):
        kind, subject, target = relation.key
        keep = "no" if relation.key in removed else "yes"
        keep = "yours" if relation.key in file.edited_by_people else keep
        table.writerow(
            [
                *(keep, keep),
                *(prefixed(iri) for iri in (subject, kind, target)),
                "" if relation.probability is None else relation.probability,
                *(relation.weight, relation.weight_against),
                *(" | ".join(relation.surfaces), " ".join(relation.sources)),
            ]
        )
    return out.getvalue()
