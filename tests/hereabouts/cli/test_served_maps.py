"""`hereabouts map` and `search` against a running `hereabouts serve`; either of them killed."""

import json
import os
import re
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import requests
from pyoxigraph import NamedNode, RdfFormat, parse

from hereabouts.cli import main
from kg.model import vocabulary as v
from kg.serving.opening import open_map
from tests.hereabouts.cli.test_serve import TOKEN, Process, home, serve, tokens
from tests.kg.conftest import canonical
from tests.planner.robots import APPLE, FAR_APPLE, command, ring
from tests.waiting import HEREABOUTS

__all__ = ["home", "serve", "tokens"]  # fixtures

BASE = "https://example.org/home/"
FRAMES = 10
Prints = Callable[..., str]
Serve = Callable[..., Process]


def untimed(text: str) -> str:
    """The recording has no clock: its frames are as old as the run that maps them."""
    text = re.sub(r'here:viewTimes "[^"]*"', 'here:viewTimes ""', text)  # minutes of that clock
    return re.sub(r"20\d\d-\d\d-\d\d[T ][\d:]{5,8}", "2020-01-01T00:00:00", text)


@pytest.fixture(autouse=True)
def token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", "")  # `trusted` sets it: to be as it was afterwards


def trusted(process: Process) -> Process:
    """A server that the token is for."""
    os.environ["HEREABOUTS_SERVER"] = process.url
    return process


@pytest.fixture
def rooms(home: Path) -> Path:
    """Three rooms to search."""
    with open_map(home) as semantic_map:
        ring(semantic_map)
    return home


def start(*words: object) -> subprocess.Popen[bytes]:
    command, pipe = [*HEREABOUTS, *map(str, words)], subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe)


def facts(path: Path, prints: Prints, folder: Path) -> set[str]:
    """What a map says, but for its title and when it was made."""
    out = folder / "out.ttl"
    prints("export", path, "-o", out)
    own, titled = NamedNode(BASE), (NamedNode(f"{BASE}ontology"), NamedNode(v.RDFS_LABEL))
    quads = parse(untimed(out.read_text()), format=RdfFormat.TURTLE, base_iri=BASE)
    return canonical(q for q in quads if q.subject != own and (q.subject, q.predicate) != titled)


def test_a_recording_mapped_into_a_served_map_makes_the_map_it_makes_in_the_folder(
    serve, kitchen, home, tokens, prints, tmp_path, fails
):
    process = trusted(serve(home, "--token-file", tokens))
    words = ("map", kitchen, "--no-check", "--limit", 4, "--json", "--into")
    report = json.loads(prints(*words, process.url))
    assert (report["frames"], report["skipped"]) == (4, 0)
    again = json.loads(prints(*words, process.url))
    assert (again["frames"], again["skipped"]) == (0, 4)
    told = prints("log", process.url, "object/1", "--json")
    assert {entry["by"] for entry in json.loads(told)} == {"ann"}
    assert report["doubted"] > 0
    assert "are stored in the map's folder" in fails("why", process.url, "--candidates")
    assert process.end() == 0
    here = tmp_path / "here.map"
    # boxes are grown from the surface, which a map on a server does not have
    prints(*words, here, "--base", BASE, "--surface", "none")
    there, mapped_here = (facts(path, prints, tmp_path) for path in (home, here))
    assert len(there) > 1000
    assert there == mapped_here
    assert prints("check", home) == ""


def test_a_search_on_a_served_map_finds_and_remembers(serve, rooms, tokens, capsys):
    process = trusted(serve(rooms, "--token-file", tokens))
    robot = f"stdio:{command(objects=[APPLE])}"
    assert main(["search", process.url, "apple", "--robot", robot, "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert (events[0]["event"], events[-1]["state"]) == ("begin", "found")
    assert process.end() == 0
    with open_map(rooms, read_only=True) as semantic_map:
        (record,) = semantic_map.searches.all()
        assert (record.state, len(semantic_map.searches.looks(record.iri))) == (
            "found",
            events[-1]["looks"],
        )
        assert [o.iri for o in semantic_map.objects("apple")] == list(record.found)


@pytest.mark.parametrize("server_dies", [False, True], ids=["the search", "the server"])
def test_a_search_cut_short_loses_no_look_and_goes_on(
    server_dies: bool, serve: Serve, rooms: Path, tokens: Path, prints: Prints, tmp_path: Path
) -> None:
    process = trusted(serve(rooms, "--token-file", tokens))
    dead = tmp_path / "dead"  # until then the robot does not look a third time
    robot = command(objects=[FAR_APPLE], at_look=3, then="wait", until=str(dead))
    words = ["--json", "--robot", f"stdio:{robot}"]
    running = start("search", process.url, "apple", *words)
    assert running.stdout is not None
    looks = 0
    for line in running.stdout:
        looks += json.loads(line)["event"] == "look"  # told once it is written
        if looks == 2:
            break
    killed = process.popen if server_dies else running
    killed.kill()
    killed.wait()
    dead.touch()
    out, err = running.communicate(timeout=120)
    looks += sum(json.loads(line)["event"] == "look" for line in out.splitlines() if line)
    if server_dies:
        assert running.returncode == 1
        last = err.decode().splitlines()[-1]
        assert re.match(r"error: http://\S+ does not answer|error: no server answers at", last)
        process.end()
        process = trusted(serve(rooms, "--token-file", tokens))
    again = [json.loads(line) for line in prints(*resumed(process.url)).splitlines()]
    # one more may have been written than was told, never one less
    assert looks <= again[0]["looks"] <= looks + 1
    assert again[-1]["state"] == "found"
    assert process.end() == 0


def resumed(url: str) -> list[str]:
    robot = f"stdio:{command(objects=[FAR_APPLE])}"
    return ["search", url, "--resume", "--json", "--robot", robot]


def applied(url: str) -> int:
    """Frames of the recording that the served map says it holds."""
    query = "SELECT ?n { ?r here:framesApplied ?n }"
    answer = requests.get(f"{url}sparql", params={"query": query}, timeout=120)
    rows = answer.json()["results"]["bindings"]
    return int(rows[0]["n"]["value"]) if rows else 0


def until(url: str, frames: int, running: subprocess.Popen[bytes]) -> None:
    while applied(url) < frames and running.poll() is None:
        time.sleep(0.05)  # or it is too many requests for a server


@pytest.fixture
def long_kitchen(shared: Callable[[str], Path], tmp_path: Path) -> Path:
    """The first frames of the real kitchen recording."""
    source, folder = shared("data/rgbd/redkitchen"), tmp_path / "long"
    folder.mkdir()
    for number in range(0, 4 * FRAMES, 4):
        for path in source.glob(f"frame-{number:06d}.*"):
            (folder / path.name).symlink_to(path)
    for name in ("color-intrinsics.txt", "camera-intrinsics.txt", "gravity-direction.txt"):
        (folder / name).symlink_to(source / name)
    return folder


def test_a_mapper_and_its_server_killed_in_turns_lose_no_frame(
    serve: Serve, long_kitchen: Path, home: Path, tokens: Path, prints: Prints
) -> None:
    process = trusted(serve(home, "--token-file", tokens))
    mapping = ("map", long_kitchen, "--no-check", "--scene", "none", "--into")
    running = start(*mapping, process.url)
    until(process.url, 2, running)
    running.kill()
    running.communicate()
    before = applied(process.url)
    assert before >= 2

    running = start(*mapping, process.url)
    until(process.url, before + 3, running)
    acknowledged = applied(process.url)
    process.popen.kill()
    _, err = running.communicate(timeout=120)
    if acknowledged < FRAMES:
        assert running.returncode == 1
        last = err.decode().splitlines()[-1]
        assert re.match(r"error: .*(does not answer|no server answers|broke off)", last)
    process.end()

    process = trusted(serve(home, "--token-file", tokens))
    there = applied(process.url)
    assert there >= acknowledged
    report = json.loads(prints(*mapping, process.url, "--json"))
    assert (report["skipped"], report["frames"]) == (there, FRAMES - there)
    assert process.end() == 0
    assert prints("check", home) == ""
    with open_map(home, read_only=True) as semantic_map:
        notes = [c.cause.note for c in semantic_map.history.changes(0) if c.cause.kind == "frame"]
        assert [*dict.fromkeys(notes)] == [f"long/frame-{n:06d}" for n in range(0, 4 * FRAMES, 4)]
        assert semantic_map.recordings()[0].frames_applied == FRAMES
