"""`hereabouts serve` as people start it: a process, its signals, a recording, a flood."""

import http.client
import os
import re
import signal
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import requests

from hereabouts.cli import main
from kg.serving.opening import create_map, open_map
from tests.waiting import HEREABOUTS, until

TOKEN = "a-token-of-the-tests-0123"
ASK = {"query": "ASK { here:Cup a ?x }"}
FLOOD = 2_000


@contextmanager
def interruptible() -> Iterator[None]:
    """What is started meanwhile hears Ctrl+C, also where we run in a background that does not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class Process:
    """A running `hereabouts serve`; `url` is where it said it answers."""

    def __init__(self, folder: Path, *words: object) -> None:
        self.said = folder / "stderr.txt"
        with self.said.open("wb") as stderr, interruptible():
            self.popen = subprocess.Popen(
                [*HEREABOUTS, "serve", *map(str, words), "--port", "0"],
                env={**os.environ, "COLUMNS": "500"},
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=stderr,
            )
        self.url = self._address()

    def _address(self) -> str:
        while self.popen.poll() is None:
            if found := re.search(r" at (http://\S+/) ", self.said.read_text()):
                return found[1]
            time.sleep(0.02)
        raise AssertionError(f"ended with {self.popen.returncode}: {self.said.read_text()}")

    def get(self, path: str, **params: object) -> requests.Response:
        return requests.get(self.url + path, params=params, timeout=120)  # type: ignore[arg-type]

    def ask(self) -> bool:
        return self.get("sparql", **ASK).json()["boolean"] is True

    def memory(self) -> int:
        """Resident memory [MB]."""
        status = Path(f"/proc/{self.popen.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) >> 10  # type: ignore[index]

    def end(self, by: signal.Signals = signal.SIGTERM) -> int:
        if self.popen.poll() is None:
            self.popen.send_signal(by)
        out, _ = self.popen.communicate(timeout=120)
        assert out == b""
        return self.popen.returncode


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Callable: words of the command -> the running process."""
    with ExitStack() as running:

        def start(*words: object) -> Process:
            process = Process(tmp_path, *words)
            running.callback(process.popen.wait)
            running.callback(process.popen.kill)
            return process

        yield start


@pytest.fixture
def home(tmp_path: Path) -> Path:
    with create_map(tmp_path / "home.map", base="https://example.org/home/"):
        return tmp_path / "home.map"


@pytest.fixture
def tokens(tmp_path: Path) -> Path:
    (tmp_path / "tokens.txt").write_text(f"ann {TOKEN}\n")
    return tmp_path / "tokens.txt"


def beside(path: Path) -> list[str]:
    return [p.name for p in path.parent.iterdir() if p.name.startswith(f".{path.name}")]


def test_it_serves_a_map_of_the_working_directory_until_told_to_end(serve, home):
    process = serve("home.map")
    assert process.ask()
    assert "reading only" in process.said.read_text()
    assert process.end() == 0
    assert "Traceback" not in process.said.read_text()
    assert beside(home) == []


@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGINT])
def test_what_was_written_is_there_after_a_signal_and_no_secret_was_told(serve, home, tokens, by):
    process = serve(home, "--token-file", tokens, "--verbose")
    headers = {"Authorization": f"Bearer {TOKEN}"}
    update = "INSERT DATA { GRAPH <urn:notes> { <urn:x> rdfs:comment 'sesame' } }"
    form = {"update": update}
    done = requests.post(process.url + "sparql", data=form, headers=headers, timeout=120)
    assert done.status_code == 200, done.text
    with requests.get(process.url + "changes", stream=True, timeout=120) as follower:
        assert process.end(by) == (0 if by == signal.SIGTERM else 130)
        follower.close()
    told = process.said.read_text()
    assert "POST '/sparql' 200" in told
    assert TOKEN not in told and "sesame" not in told and "Traceback" not in told
    assert beside(home) == []
    with open_map(home) as semantic_map:
        assert semantic_map.query("SELECT ?n { <urn:x> rdfs:comment ?n }").rows == (("sesame",),)


def test_an_answer_that_is_not_ready_at_the_end_is_told_so(serve, home):
    process = serve(home, "--timeout", "300", "--verbose")
    answers: list[requests.Response] = []
    endless = {"query": "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }"}
    asking = threading.Thread(target=lambda: answers.append(process.get("sparql", **endless)))
    asking.start()
    until(lambda: "hereabouts_query_workers_busy 1" in process.get("metrics").text)
    assert process.end() == 0
    asking.join()
    assert (answers[0].status_code, answers[0].text.split(";")[0]) == (
        503,
        "the server is shutting down",
    )
    assert "Traceback" not in process.said.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--allow-origin", "example.org"), "no origin of web pages: 'example.org'"),
        (("--allow-origin", "https://example.org/"), "no slash at the end"),
        (("--allow-service", "sparql"), "no IRI: 'sparql'"),
    ],
)
def test_what_could_never_work_is_refused_at_once(home, words, said, capsys):
    assert main(["serve", str(home), "--port", "0", *words]) == 1
    assert said in capsys.readouterr().err


def test_a_recording_is_mapped_while_questions_are_answered(serve, kitchen, shared, tmp_path):
    detector = shared("models/deimv2_femto_416.onnx")
    into = tmp_path / "live.map"
    process = serve(into, "--recording", kitchen, "--detector", detector)
    seen: list[int] = []
    query = {"query": "SELECT (COUNT(?o) AS ?n) { GRAPH graph:map { ?o here:existence ?e } }"}
    while True:
        (row,) = process.get("sparql", **query).json()["results"]["bindings"]
        seen.append(int(row["n"]["value"]))
        (state,) = process.get("health").json()["mapping"].values() or ("",)
        assert "failed" not in str(state)
        if "done" in str(state):
            break
        time.sleep(0.02)  # or it is too many requests for a server
    assert state == "done: 8 frames mapped, 0 were mapped before"
    sequence = process.get("health").json()["sequence"]
    assert sequence >= 8
    assert process.end() == 0
    with open_map(into, read_only=True) as semantic_map:
        assert semantic_map.recordings()[0].frames_applied == 8
        assert semantic_map.sequence == sequence
        assert len(semantic_map.objects()) > 0


def test_a_signal_in_the_middle_of_a_recording_keeps_whole_frames(serve, kitchen, shared, tmp_path):
    detector = shared("models/deimv2_femto_416.onnx")
    into = tmp_path / "live.map"
    process = serve(into, "--recording", kitchen, "--detector", detector)
    until(lambda: process.get("health").json()["sequence"] >= 2)
    assert process.end() == 0
    with open_map(into) as semantic_map:
        applied = semantic_map.recordings()[0].frames_applied
        assert 0 < applied <= 8
        assert semantic_map.robot() is not None
    assert main(["check", str(into)]) == 0


def keep_alive(process: Process, count: int) -> Iterator[tuple[int, str | None]]:
    """Statuses, and Retry-After, of requests over connections that stay open."""
    host = process.url.removeprefix("http://").rstrip("/")
    for _ in range(count // 500):
        connection = http.client.HTTPConnection(host, timeout=120)
        for _ in range(500):
            connection.request("GET", "/health")
            answer = connection.getresponse()
            answer.read()
            yield answer.status, answer.headers["Retry-After"]
        connection.close()


def anew(process: Process, count: int) -> Iterator[tuple[int, str | None]]:
    """The same, each over a connection of its own."""
    host = process.url.removeprefix("http://").rstrip("/")
    for _ in range(count):
        connection = http.client.HTTPConnection(host, timeout=120)
        connection.request("GET", "/health", headers={"Connection": "close"})
        answer = connection.getresponse()
        answer.read()
        yield answer.status, answer.headers["Retry-After"]
        connection.close()


def test_a_flood_of_requests_is_refused_politely_and_the_server_stays(serve, home):
    process = serve(home)
    assert process.ask()
    before = process.memory()
    told: Counter[tuple[int, bool]] = Counter()
    for flood in (keep_alive, anew):
        for status, wait in flood(process, FLOOD // 2):
            told[status, wait is not None] += 1
    assert sum(told.values()) == FLOOD
    assert set(told) <= {(200, False), (429, True), (503, True)}
    while (answer := process.get("sparql", **ASK)).status_code == 429:
        time.sleep(int(answer.headers["Retry-After"]))
    assert answer.json()["boolean"] is True
    assert process.memory() < before + 64
    assert process.end() == 0
