"""Files of pictures: PNG, SVG or PDF by their ending, the same bytes for the same drawing."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure

from kg.errors import PictureError

FORMATS: Final = (".png", ".svg", ".pdf")
#: settings of matplotlib while a picture is drawn
STYLE: Final[dict[Any, Any]] = {"font.family": "DejaVu Sans", "svg.hashsalt": "hereabouts"}

#: What would make two drawings of one map differ is left out.
_METADATA: Final[dict[str, dict[str, Any]]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}


def checked_ending(path: Path | str) -> Path:
    """`path`; raises PictureError unless it has one of the endings of FORMATS."""
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        given = f"the ending {path.suffix}" if path.suffix else "no ending"
        raise PictureError(f"cannot draw {path.name!r} with {given}; .png, .svg or .pdf would work")
    return path


def save_picture(figure: Figure, path: Path) -> None:
    """Write `figure` to `path`; raises PictureError where it cannot be written."""
    kind = path.suffix.lower()
    try:
        figure.savefig(
            path, dpi=figure.dpi, facecolor="white", format=kind[1:], metadata=_METADATA[kind]
        )
    except OSError as error:
        raise PictureError(f"cannot write {path}: {error.strerror or error}") from error
