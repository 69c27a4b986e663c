"""Detection files: the detection report in the folder of a map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from kg.model.errors import GraphError
from mapping.detection_report import DetectionReport, report_from_json

NAME: Final = "detections.json"  # in the folder of a map
MAX_BYTES: Final = 2_000_000


def read_report(folder: Path) -> DetectionReport | None:
    """The report in the folder of a map; None where there is none.

    Raises GraphError for a file that holds none, is too large, or is a link to another one.
    """
    path = folder / NAME
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise GraphError(f"{path} is no file of its own; without it, mapping writes a new one")
    if not path.exists():
        return None
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise GraphError(f"cannot read {path}: {error.strerror or error}") from error
    if len(data) > MAX_BYTES:
        raise GraphError(
            f"{path} is larger than {MAX_BYTES // 1_000_000} MB, and no detection report"
        )
    try:
        return report_from_json(json.loads(data))
    except KeyError as error:
        raise GraphError(f"{path} is no detection report: it has no {error}") from error
    except (ValueError, TypeError, RecursionError) as error:
        reason = " ".join(str(error).split())[:100]
        raise GraphError(f"{path} is no detection report: {reason}") from error


def write_report(folder: Path, report: DetectionReport) -> None:
    """Write the report into the folder of a map; raises GraphError where that fails."""
    from kg.store.atomic_file import write_atomically

    path = folder / NAME
    try:
        if path.is_symlink():
            path.unlink()  # it may lead to a file that is not the map's
        if path.exists() and not path.is_file():
            raise GraphError(f"{path} is no file of its own")
    except OSError as error:
        raise GraphError(f"cannot write {path}: {error.strerror or error}") from error
    text = json.dumps(report.to_json(), ensure_ascii=False, allow_nan=False)
    write_atomically(path, text.encode("utf-8", "replace"))
