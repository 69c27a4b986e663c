"""Fetch one file over HTTP: resumed where it broke off, checked by hash, put in place at once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import requests

from kg.model.errors import ModelError

BLOCK = 1 << 16  # bytes
TIMEOUT = (10, 60)  # [s] to connect, and between two blocks


@dataclass(frozen=True, slots=True)
class Expected:
    """The content that is wanted, by its hash."""

    kind: str  # "sha256" | "git blob"
    digest: str  # hexadecimal

    def matches(self, path: Path) -> bool:
        """Whether the file has this content."""
        found = sha256_of(path) if self.kind == "sha256" else git_blob_of(path)
        return found == self.digest


def sha256_of(path: Path) -> str:
    """Hexadecimal sha256 of a file; raises ModelError if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ModelError(f"cannot read {path}: {error.strerror}") from error


def git_blob_of(path: Path) -> str:
    """Hexadecimal sha1 by which git names a file of this content."""
    digest = hashlib.sha1(b"blob %d\0" % path.stat().st_size, usedforsecurity=False)
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def download(
    url: str, path: Path, expected: Expected, on_progress: Callable[[int], None] | None = None
) -> None:
    """Fetch `url` to `path`, taking up what an earlier attempt left in PATH.part.

    `path` appears only once its content is checked; a file of other content is deleted. Raises
    ModelError where the address cannot be reached, answers with an error, breaks off, or serves
    something else.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _continue(url, part, on_progress)
        if not expected.matches(part):
            size = part.stat().st_size
            part.unlink()
            raise ModelError(
                f"{url} served {size} bytes with another {expected.kind} than "
                f"{expected.digest[:12]}...: deleted; try again, or report it if it stays so"
            )
        part.replace(path)
    except requests.RequestException as error:
        raise ModelError(
            f"cannot fetch {url}: {_reason(error)}; run the same again to continue"
        ) from error
    except OSError as error:
        raise ModelError(f"cannot write {path}: {error.strerror or error}") from error


def _continue(url: str, part: Path, on_progress: Callable[[int], None] | None) -> None:
    done = part.stat().st_size if part.is_file() else 0
    headers = {"Range": f"bytes={done}-"} if done else {}
    # a compressed transfer would make byte ranges and lengths mean something else
    headers["Accept-Encoding"] = "identity"
    with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT) as answer:
        if answer.status_code == requests.codes.requested_range_not_satisfiable:
            return  # all of it is here already, or it is not ours: the hash tells
        if answer.status_code not in (requests.codes.ok, requests.codes.partial_content):
            raise ModelError(f"{url} answered {answer.status_code} {answer.reason}")
        resumed = answer.status_code == requests.codes.partial_content
        done = done if resumed else 0
        with part.open("ab" if resumed else "wb") as file:
            for block in answer.iter_content(BLOCK):
                file.write(block)
                done += len(block)
                if on_progress is not None:
                    on_progress(done)


def _reason(error: requests.RequestException) -> str:
    if isinstance(error, requests.Timeout):
        return "no answer in time"
    if isinstance(error, requests.exceptions.ChunkedEncodingError):
        return "the connection broke off"
    if isinstance(error, requests.ConnectionError):
        return "no connection (offline?)"
    return str(error).splitlines()[0]
