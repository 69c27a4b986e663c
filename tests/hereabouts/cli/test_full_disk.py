"""A served map whose disk fills up: reads go on, errors name the map, writes work again."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import requests

from kg.serving.opening import create_map, open_map
from tests.hereabouts.cli.test_serve import TOKEN, Process
from tests.waiting import until

NAMED = "no space left on the disk of map flat.map; free some and retry"
COUNT = 'SELECT (COUNT(*) AS ?n) { ?s rdfs:comment ?x FILTER STRSTARTS(STR(?s), "urn:n:") }'
READING = (
    "INSERT { ?s rdfs:label 'b' } WHERE { ?s rdfs:comment ?c FILTER CONTAINS(STR(?s), 'urn:n:') }"
)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 48 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=48m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(words, check=False).returncode:
        pytest.skip("mounting a small disk needs the rights of an administrator")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


class Client:
    """Writes and reads over HTTP; `acknowledged` has the numbers that were written."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.acknowledged: list[int] = []

    def write(self, number: int) -> requests.Response:
        answer = self.update(f"INSERT DATA {{ <urn:n:{number}> rdfs:comment '{'x' * 500}' }}")
        if answer.status_code == 200:
            self.acknowledged.append(number)
        return answer

    def update(self, text: str) -> requests.Response:
        headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/sparql-update"}
        return requests.post(self.url + "sparql", data=text, headers=headers, timeout=120)

    def read(self, **headers: str) -> requests.Response:
        given = {"query": COUNT}
        return requests.get(self.url + "sparql", params=given, headers=headers, timeout=120)

    def refused(self) -> requests.Response:
        """Write until a write is refused."""
        return next(a for n in range(10_000) if (a := self.write(n)).status_code != 200)


@contextmanager
def served(folder: Path, *words: object) -> Iterator[str]:
    """The address of a `hereabouts serve`, which is told to end after the block."""
    process = Process(folder, *words)
    try:
        yield process.url
        assert process.end() == 0
        assert "Traceback" not in process.said.read_text()
    finally:
        process.popen.kill()
        process.popen.communicate()


def filled(ballast: Path, leaving: int) -> None:
    """Fill the disk of `ballast` up to some bytes."""
    with ballast.open("wb") as file:
        while (free := os.statvfs(file.fileno())).f_bavail * free.f_frsize > leaving:
            file.write(bytes(4096))
            file.flush()


@pytest.mark.parametrize("leaving", [20_000, 300_000])
def test_reads_go_on_and_writes_work_again_once_there_is_space(disk, tmp_path, leaving):
    path, tokens = disk / "flat.map", tmp_path / "tokens"
    create_map(path).close()
    tokens.write_text(f"ann {TOKEN}\n")
    tokens.chmod(0o600)
    with served(tmp_path, path, "--token-file", tokens) as url:
        client = Client(url)
        assert client.read().status_code == client.write(10_001).status_code == 200
        filled(disk / "ballast", leaving)
        refused = client.refused()
        assert (refused.status_code, refused.text.strip()) == (507, NAMED)
        assert client.read().status_code == 200
        assert client.read(Authorization=f"Bearer {TOKEN}").status_code == 200
        reading = client.update(READING)  # a worker needs space for it
        assert (reading.status_code, reading.text.strip()) == (507, NAMED)
        (disk / "ballast").unlink()
        until(lambda: client.write(10_002).status_code == 200)
        until(lambda: client.update(READING).status_code == 200)
    with open_map(path) as semantic_map:
        kept = {row[0] for row in semantic_map.query("SELECT ?s { ?s rdfs:comment ?x }").rows}
    assert {f"urn:n:{number}" for number in client.acknowledged} <= kept
