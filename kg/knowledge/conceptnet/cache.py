"""Response cache of the web API on disk, so that an interrupted import can be resumed."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path

from kg.model.errors import ConceptNetError


@dataclass(frozen=True, slots=True)
class ResponseCache:
    """Response cache in a folder, one file each; a damaged file counts as absent."""

    folder: Path

    def get(self, url: str) -> dict[str, object] | None:
        """The cached response for a URL, or None."""
        try:
            stored = json.loads(self._path(url).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(stored, dict) or stored.get("url") != url:
            return None
        answer = stored.get("answer")
        return answer if isinstance(answer, dict) else None

    def put(self, url: str, answer: dict[str, object]) -> None:
        """Store a response atomically.

        Raises:
            ConceptNetError: the folder cannot be written.
        """
        path = self._path(url)
        part = path.with_suffix(f".{os.getpid()}.part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps({"url": url, "answer": answer}))
            part.replace(path)
        except OSError as error:
            raise ConceptNetError(f"cache {self.folder}: {error.strerror or error}") from None

    def _path(self, url: str) -> Path:
        return self.folder / f"{hashlib.sha256(url.encode()).hexdigest()[:32]}.json"
