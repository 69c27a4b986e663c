"""The registry of networks and fetching from it, over this machine's own loopback."""

import hashlib
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import ModelError
from perception.inference import model_zoo as models
from perception.inference.encoders import open_encoder
from perception.inference.model_zoo import (
    ModelCard,
    fetch_model,
    find_model,
    git_blob_of,
    known_models,
    model_path,
    sha256_of,
)
from perception.inference.scene_classifier import load_scene_classifier
from tests.encoder_files import write_colour_pair

CONTENT = np.random.default_rng(0).bytes(300_000)


class Home(ThreadingHTTPServer):
    """A home of networks that can cut connections and ignore ranges."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.content = CONTENT
        self.others: dict[str, bytes] = {}
        self.cut_after: int | None = None
        self.ranges = True
        self.asked: list[str | None] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/network.onnx"


class Answer(BaseHTTPRequestHandler):
    server: Home

    def do_GET(self) -> None:
        home = self.server
        asked = self.headers.get("Range")
        home.asked.append(asked)
        content = {"/network.onnx": home.content, **home.others}.get(self.path)
        if content is None:
            self.send_error(404)
            return
        start = int(asked.removeprefix("bytes=").rstrip("-")) if asked and home.ranges else 0
        if start >= len(content):
            self.send_error(416)
            return
        body = content[start:]
        self.send_response(206 if asked and home.ranges else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[: home.cut_after])
        self.close_connection = True

    def log_message(self, *arguments: object) -> None:
        """Keep the test's output clean."""


@pytest.fixture
def home(monkeypatch, tmp_path) -> Iterator[Home]:
    server = Home()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def publish(home, monkeypatch):
    """Callable: makes a network of that address and hash known as "tiny"."""

    def add(**card: object) -> ModelCard:
        told = {"url": home.url, "sha256": hashlib.sha256(CONTENT).hexdigest(), **card}
        usual = {"kind": "scene", "resize": "crop", "values": "0..255"}
        model = ModelCard(name="tiny", licence="MIT", quality="none", **{**usual, **told})
        monkeypatch.setattr(models, "cards", lambda: (model,))
        return model

    return add


def test_bundled_networks_are_what_their_cards_say():
    bundled = [model for model in known_models() if model.where == "bundled"]
    assert {model.kind for model in bundled if model.default} == {"detector", "scene"}
    for model in bundled:
        path = model_path(model.name)
        assert sha256_of(path) == model.sha256
        assert path.stat().st_size == model.size


def test_every_card_can_be_checked_and_names_its_licence():
    for model in known_models():
        assert model.licence
        assert model.to_json()["name"] == model.name
        if model.kind == "encoder":
            assert {len(digest) for digest in model.parts.values()} == {64} and model.size
            assert "vision" in list(model.parts)[-1] and "tokenizer.json" in model.parts
            continue
        assert model.sha256 or model.git_blob
        assert model.resize in ("stretch", "letterbox", "crop")
        assert model.values in ("0..255", "0..255 bgr", "0..1", "imagenet")


def test_the_shared_networks_are_recognised_by_content(shared, tmp_path):
    renamed = tmp_path / "mine.onnx"
    renamed.symlink_to(shared("models/nanodet_g_416.onnx"))
    path, card = models.resolve(renamed, "detector")
    assert path == renamed
    assert card is not None
    assert (card.name, card.resize) == ("nanodet_g_416", "stretch")


def test_git_blob_is_counted_as_git_does(tmp_path):
    path = tmp_path / "hello"
    path.write_bytes(b"hello\n")
    assert git_blob_of(path) == "ce013625030ba8dba906f756967f9e9ca394464a"


def test_a_network_is_fetched_once_and_found_afterwards(home, publish):
    assert publish().where == "to fetch"
    with pytest.raises(ModelError, match="run `hereabouts models fetch tiny`"):
        model_path("tiny")
    seen: list[int] = []
    path = fetch_model("tiny", on_progress=seen.append)
    assert path.read_bytes() == CONTENT
    assert seen[-1] == len(CONTENT)
    assert seen == sorted(seen)
    assert find_model("tiny").where == "fetched"
    assert model_path("tiny") == fetch_model("tiny") == path
    assert home.asked == [None], "what is there is not fetched again"


def test_a_cut_download_is_taken_up_where_it_broke_off(home, publish):
    publish()
    home.cut_after = 100_000
    with pytest.raises(ModelError, match="run the same again to continue"):
        fetch_model("tiny")
    assert not models.cached_path(find_model("tiny")).exists()
    home.cut_after = None
    assert fetch_model("tiny").read_bytes() == CONTENT
    assert home.asked[1] is not None
    assert 0 < int(home.asked[1].removeprefix("bytes=").rstrip("-")) <= 100_000


def test_a_server_that_ignores_ranges_starts_over(home, publish):
    publish()
    home.cut_after = 100_000
    with pytest.raises(ModelError):
        fetch_model("tiny")
    home.cut_after, home.ranges = None, False
    assert fetch_model("tiny").read_bytes() == CONTENT


def test_a_download_that_is_already_whole_is_only_checked(home, publish):
    path = models.cached_path(publish())
    path.parent.mkdir(parents=True)
    path.with_name(path.name + ".part").write_bytes(CONTENT)
    assert fetch_model("tiny").read_bytes() == CONTENT
    assert home.asked == [f"bytes={len(CONTENT)}-"]


def test_other_content_is_refused_and_leaves_nothing_behind(home, publish):
    path = models.cached_path(publish())
    home.content = b"something else" * 100
    with pytest.raises(ModelError, match="served 1400 bytes with another sha256"):
        fetch_model("tiny")
    assert list(path.parent.iterdir()) == []


def test_git_blobs_are_checked_too(publish, tmp_path):
    (tmp_path / "content").write_bytes(CONTENT)
    publish(sha256=None, git_blob=git_blob_of(tmp_path / "content"))
    assert fetch_model("tiny").read_bytes() == CONTENT


def test_labels_are_fetched_beside_the_network(home, publish, write_network):
    network = write_network({"probs": np.array([[0.25, 0.75]], np.float32)})
    labels = b"/k/kitchen 0\n/b/bedroom 1\n"
    home.others["/labels.txt"] = labels
    home.content = network.read_bytes()
    publish(
        sha256=hashlib.sha256(home.content).hexdigest(),
        labels_url=home.url.replace("network.onnx", "labels.txt"),
        labels_sha256=hashlib.sha256(labels).hexdigest(),
    )
    fetch_model("tiny")
    assert load_scene_classifier("tiny").labels == ("kitchen", "bedroom")


def test_an_encoder_is_fetched_in_parts_and_opened_by_its_name(home, publish, tmp_path):
    write_colour_pair(tmp_path / "pair")
    parts = ["tokenizer.json", "text.onnx", "image.onnx"]
    home.others = {f"/{part}": (tmp_path / "pair" / part).read_bytes() for part in parts}
    known = {part: sha256_of(tmp_path / "pair" / part) for part in parts}
    card = publish(kind="encoder", url=home.url.replace("network.onnx", ""), parts=known)
    with pytest.raises(ModelError, match="run `hereabouts models fetch tiny`"):
        open_encoder("tiny")
    text, home.others["/text.onnx"] = home.others["/text.onnx"], b"another"
    with pytest.raises(ModelError, match="served 7 bytes with another sha256"):
        fetch_model("tiny")
    assert card.where == "to fetch"
    home.others["/text.onnx"] = text
    seen: list[int] = []
    fetch_model("tiny", on_progress=seen.append)
    assert card.where == "fetched" and seen == sorted(seen) and home.asked == [None] * 4
    assert seen[-1] == sum(map(len, home.others.values()))
    assert open_encoder("tiny").encode_text("cup").shape == (3,)
    with pytest.raises(ModelError, match="tiny is of the kind encoder, and a detector is wanted"):
        models.resolve("tiny", "detector")


def test_nothing_is_fetched_without_a_hash(home, publish):
    publish(sha256=None)
    with pytest.raises(ModelError, match="nothing unchecked is fetched"):
        fetch_model("tiny")
    assert home.asked == []


def test_a_missing_file_and_a_silent_host_say_so(home, publish):
    publish(url=home.url.replace("network.onnx", "gone.onnx"))
    with pytest.raises(ModelError, match="answered 404"):
        fetch_model("tiny")
    publish(url="http://127.0.0.1:9/network.onnx")
    with pytest.raises(ModelError, match=r"no connection \(offline\?\)"):
        fetch_model("tiny")


def test_a_cache_that_cannot_be_written_says_so(publish, tmp_path, monkeypatch):
    publish()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(ModelError, match="cannot write"):
        fetch_model("tiny")


def test_the_cache_lies_where_the_environment_says(monkeypatch):
    monkeypatch.setenv("HEREABOUTS_CACHE", "/somewhere")
    assert models.cache_folder() == Path("/somewhere")
    monkeypatch.delenv("HEREABOUTS_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/caches")
    assert models.cache_folder() == Path("/caches/hereabouts")


def test_unknown_and_homeless_networks():
    with pytest.raises(ModelError, match="did you mean deimv2_femto"):
        find_model("deimv2_femto_coc")
    with pytest.raises(ModelError, match="give its file's path"):
        fetch_model("nanodet_plus_m_416")
