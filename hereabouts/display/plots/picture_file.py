"""Files of pictures: PNG, SVG or PDF by their ending, the same bytes for the same drawing."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from matplotlib import font_manager, rc_context
from matplotlib.figure import Figure

from kg.model.errors import PictureError
from kg.store.folder import check_outside_maps

FORMATS: Final = (".png", ".svg", ".pdf")
#: fonts by preference; the later ones have scripts that the first lacks
_FONTS: Final = ("DejaVu Sans", "Noto Sans CJK JP", "Noto Sans Arabic", "Noto Emoji", "Symbola")

#: Metadata that would differ between two drawings of one map is left out.
_METADATA: Final[dict[str, dict[str, Any]]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}


@contextmanager
def picture_style() -> Iterator[None]:
    """The settings of matplotlib for drawing and saving pictures."""
    installed = set(font_manager.get_font_names())
    style: dict[Any, Any] = {
        "font.family": [name for name in _FONTS if name in installed],
        "svg.hashsalt": "hereabouts",
        "savefig.bbox": "tight",  # legends and lists stand outside the axes
        "savefig.pad_inches": 0.2,
        "text.parse_math": False,  # labels may contain dollar signs
    }
    with rc_context(style), warnings.catch_warnings():
        # a letter that no font has is drawn as a box
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def checked_ending(path: Path | str) -> Path:
    """`path`; raises PictureError unless it has one of the endings of FORMATS."""
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        given = f"the ending {path.suffix}" if path.suffix else "no ending"
        raise PictureError(f"cannot draw {path.name!r} with {given}; .png, .svg or .pdf would work")
    return path


def save_picture(figure: Figure, path: Path) -> None:
    """Write `figure` to `path`; raises PictureError if it cannot be written."""
    kind = path.suffix.lower()
    check_outside_maps(path)
    try:
        figure.savefig(
            path, dpi=figure.dpi, facecolor="white", format=kind[1:], metadata=_METADATA[kind]
        )
    except OSError as error:
        raise PictureError(f"cannot write {path}: {error.strerror or error}") from error
