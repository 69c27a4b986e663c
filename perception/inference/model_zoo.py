"""Model zoo: cards of known networks, and the download and resolution of their files.

Cards are in `networks/registry.toml`. Some networks ship with the package, others are fetched on
request into a cache folder, others are the user's own; a card has the input format of its network.
"""

from __future__ import annotations

import functools
import hashlib
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from kg.model.errors import ModelError, did_you_mean
from kg.model.extensions import DETECTORS, extensions

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
    import requests  # as late as possible: models that are here start faster

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
    import requests

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


def _reason(error: OSError) -> str:
    import requests

    if isinstance(error, requests.Timeout):
        return "no answer in time"
    if isinstance(error, requests.exceptions.ChunkedEncodingError):
        return "the connection broke off"
    if isinstance(error, requests.ConnectionError):
        return "no connection (offline?)"
    return str(error).splitlines()[0]


NETWORKS = Path(__file__).resolve().parent / "networks"


@dataclass(frozen=True, slots=True)
class ModelCard:
    """Model card: what is known of a network before it is opened."""

    name: str
    kind: str  # "detector" | "scene" | "encoder"
    licence: str
    quality: str  # one line for people
    resize: str = ""  # "stretch" | "letterbox" | "crop"
    values: str = ""  # "0..255" | "0..255 bgr" | "0..1" | "imagenet"
    default: bool = False  # the one of its kind that is used unless another is named
    file: str | None = None  # shipped under this name
    url: str | None = None  # fetched from here
    sha256: str | None = None
    git_blob: str | None = None  # sha1 as git counts it, where only that is published
    size: int = 0  # [bytes], 0 = not published
    labels: str | None = None  # name of a shipped list of labels
    ap: float | None = None  # [%] of a detector on COCO, as published
    labels_url: str | None = None
    labels_sha256: str | None = None
    #: files of an encoder below `url`, which ends with /, and the sha256 of each; images' the last
    parts: Mapping[str, str] = field(default_factory=dict)
    extension: bool = False  # whether another distribution adds it

    @property
    def where(self) -> str:
        """Its state: "bundled", "fetched", "to fetch", "extension", or "bring your own"."""
        if self.file is not None:
            return "bundled"
        if self.extension:
            return "extension"
        if cached_path(self).is_file():
            return "fetched"
        return "to fetch" if self.url is not None else "bring your own"

    def to_json(self) -> dict[str, str | int | bool | None]:
        """Plain values for `--json`."""
        return {
            "name": self.name,
            "kind": self.kind,
            "default": self.default,
            "where": self.where,
            "size": self.size or None,
            "licence": self.licence,
            "quality": self.quality,
            "url": self.url,
            "sha256": self.sha256,
            "git_blob": self.git_blob,
        }


@functools.cache
def cards() -> tuple[ModelCard, ...]:
    """Every network with a card, also those that people must bring themselves."""
    with (NETWORKS / "registry.toml").open("rb") as file:
        return tuple(ModelCard(name=name, **entry) for name, entry in tomllib.load(file).items())


def known_models() -> tuple[ModelCard, ...]:
    """The networks that ship with hereabouts or can be fetched, bundled ones first."""
    return tuple(model for model in cards() if model.file is not None or model.url is not None)


def extension_cards() -> Iterator[ModelCard]:
    """A card of each detector that another distribution adds."""
    for name, point in sorted(extensions(DETECTORS).items()):
        owner = point.dist
        licence = owner.metadata.json.get("license_expression") if owner is not None else None
        source = f"of {owner.name} {owner.version}" if owner is not None else point.value
        yield ModelCard(name, "detector", str(licence or "-"), source, extension=True)


def find_model(name: str) -> ModelCard:
    """The card of a known network; raises ModelError with the known names for any other."""
    for model in cards():
        if model.name == name:
            return model
    names = [*(model.name for model in cards()), *extensions(DETECTORS)]
    raise ModelError(
        f"no network {name!r}{did_you_mean(name, names)}; there are: {', '.join(names)}"
    )


def default_model(kind: str) -> ModelCard:
    """The bundled network of `kind` ("detector" or "scene")."""
    return next(model for model in cards() if model.kind == kind and model.default)


def bundled_pair() -> tuple[str, str]:
    """Names of the two bundled detectors, the default one first."""
    first = default_model("detector").name
    bundled = (card.name for card in cards() if card.kind == "detector" and card.file is not None)
    return first, next(name for name in bundled if name != first)


def best_detector() -> ModelCard:
    """The detector of highest published AP among those that can be fetched."""
    fetchable = [card for card in cards() if card.kind == "detector" and card.url is not None]
    return max(fetchable, key=lambda card: card.ap or 0.0)


def cache_folder() -> Path:
    """Folder of fetched networks: $HEREABOUTS_CACHE, else hereabouts in the user's cache folder."""
    given = os.environ.get("HEREABOUTS_CACHE")
    if given:
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "hereabouts"


def cached_path(model: ModelCard) -> Path:
    """File of a network once it is fetched; of an encoder, that of images."""
    if model.parts:
        return cache_folder() / model.name / list(model.parts)[-1]
    return cache_folder() / f"{model.name}.onnx"


def encoder_files(name: str) -> list[Path]:
    """Networks of images and of texts of a known encoder; [] for another name.

    Raises ModelError where they are not fetched yet.
    """
    parts = next((model.parts for model in cards() if model.name == name), {})
    folder = cache_folder() / name
    networks = [folder / part for part in parts if part.endswith(".onnx")]
    return [model_path(name), networks[0]] if networks else []


def model_path(name: str) -> Path:
    """The file of a known network; raises ModelError where it is not on this machine."""
    model = find_model(name)
    if model.file is not None:
        return NETWORKS / model.file
    path = cached_path(model)
    if path.is_file():
        return path
    if model.url is None:
        raise ModelError(f"network {name} is not bundled and has no address: give its file's path")
    raise ModelError(f"network {name} is not fetched yet: run `hereabouts models fetch {name}`")


def fetch_model(name: str, *, on_progress: Callable[[int], None] | None = None) -> Path:
    """Download a known network, check it, and return its file; at once if it is there already.

    An interrupted download is taken up where it broke off. Nothing lies at the returned path before
    its hash has been found right. `on_progress` gets the bytes that are here so far. Raises
    ModelError: no network, no such file at the address, another content than the card says.
    """
    model = find_model(name)
    if model.file is not None or cached_path(model).is_file() or model.url is None:
        return model_path(name)
    path, done = cached_path(model), 0
    if model.labels_url is not None and model.labels_sha256 is not None:
        expected = Expected("sha256", model.labels_sha256)
        download(model.labels_url, path.with_suffix(".labels.txt"), expected)
    for part, digest in model.parts.items():
        file = cache_folder() / model.name / part
        report = None if on_progress is None else lambda n, done=done: on_progress(done + n)
        if not file.is_file():
            download(model.url + part, file, Expected("sha256", digest), report)
        done += file.stat().st_size
    if not model.parts:
        download(model.url, path, _expected(model), on_progress)
    return path


def _expected(model: ModelCard) -> Expected:
    if model.sha256 is not None:
        return Expected("sha256", model.sha256)
    if model.git_blob is not None:
        return Expected("git blob", model.git_blob)
    raise ModelError(f"the card of {model.name} has no hash: nothing unchecked is fetched")


def resolve(name_or_path: str | Path, kind: str) -> tuple[Path, ModelCard | None]:
    """File and, if known, card of a network given as "default", by name, or by path.

    A file is recognised by its content, else by its name without suffix. Raises ModelError for an
    unknown name, a missing file, or a network of the other kind.
    """
    if name_or_path == "default":
        found = default_model(kind)
        return model_path(found.name), found
    path = Path(name_or_path)
    looks_like_path = path.suffix == ".onnx" or len(path.parts) > 1 or path.is_file()
    if not looks_like_path:
        known = find_model(str(name_or_path))
        path = model_path(known.name)
    elif not path.is_file():
        raise ModelError(f"no network file {path}")
    else:
        recognised = recognise(path)
        if recognised is None:
            return path, None
        known = recognised
    if known.kind != kind:
        raise ModelError(f"{known.name} is of the kind {known.kind}, and a {kind} is wanted")
    return path, known


def recognise(path: Path) -> ModelCard | None:
    """The card whose sha256 the file has, else the one with the file's name, else None."""
    digest = sha256_of(path)
    by_hash = [known for known in cards() if known.sha256 == digest]
    by_name = [known for known in cards() if known.name == path.stem]
    return next(iter(by_hash + by_name), None)
