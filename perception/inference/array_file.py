"""Files of named arrays (.npz): written whole, and read with a limit since others may make them."""

from __future__ import annotations

import io
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError

#: errors of zipfile, zlib and numpy for damaged files
DAMAGE: Final = (
    *(OSError, ValueError, KeyError, TypeError, EOFError, SyntaxError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, tokenize.TokenError),
)


def read_arrays(path: Path, max_bytes: int) -> dict[str, NDArray[Any]]:
    """Arrays of a file by name; raises one of `DAMAGE` for a file that is missing or damaged."""
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > max_bytes:
            raise ValueError("it is too large")
    with np.load(path, allow_pickle=False) as data:
        return dict(data)


def write_arrays(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Write arrays over a former file; raises ModelError, and the former file stays."""
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)  # type: ignore[arg-type]
    part = path.with_suffix(".part")
    try:
        part.write_bytes(packed.getvalue())
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise ModelError(f"cannot write {path}: {error.strerror}") from error
