"""Maps mirrored into SPARQL servers of other makers: live, resumed, and exactly."""

import random
import signal
import subprocess
import threading
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from pyoxigraph import Quad

from hereabouts.cli import main
from kg.history.storage.log import BACKGROUND
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import GraphError
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import create_map, in_memory_map, open_map
from kg.serving.publishing import Publisher, PublishTarget
from kg.serving.server import MapServer
from kg.store.sparql_backend import GRAPHS
from tests.small_server import SMALL
from tests.waiting import HEREABOUTS, until

NORTH, SOUTH = "https://example.org/north/", "https://example.org/south/"
PATIENCE = 120.0  # [s] for what comes at once, on a machine however slow


def see(semantic_map: SemanticMap, label: str, x: float, number: int | None = None) -> None:
    """A robot sees something: one frame."""
    iri = semantic_map.new_object_iri() if number is None else f"{semantic_map.base}object/{number}"
    category = semantic_map.catalogue.find(label).iri
    position = np.array([x, 0.5, 0.8])
    record = ObjectRecord(iri, category, position, 1.0, 0.75, 3, 1e9, 1e9 + 5)
    semantic_map.apply(MapUpdate(objects=(record,)))


def own(quads: Iterable[Quad]) -> set[Quad]:
    """Facts of maps alone: no ontology, no bookkeeping, no graphs of the server itself."""
    graphs = {*GRAPHS} - {graph.value for graph in BACKGROUND}
    return {
        quad
        for quad in quads
        if getattr(quad.graph_name, "value", "") in graphs and quad.predicate.value != v.SEQUENCE
    }


def published(url: str) -> set[Quad]:
    with open_map(url, read_only=True) as mirror:
        return own(mirror.engine)


both = pytest.mark.parametrize("url", ["oxigraph", "virtuoso"], indirect=True)


@pytest.fixture
def robots() -> Iterator[tuple[SemanticMap, SemanticMap]]:
    with (
        in_memory_map(title="north", base=NORTH) as north,
        in_memory_map(title="south", base=SOUTH) as south,
    ):
        for robot in (north, south):
            see(robot, "cup", 1.0)
            see(robot, "chair", 2.0)
        yield north, south


@pytest.fixture
def live(robots: tuple[SemanticMap, SemanticMap], url: str) -> Iterator[list[Publisher]]:
    """Two served maps, followed into one server."""
    with ExitStack() as running:
        target = PublishTarget(url)
        running.callback(target.close)
        publishers = []
        for robot in robots:
            server = running.enter_context(MapServer(robot, SMALL))
            publishers.append(Publisher(server.url, target))
        threads = [threading.Thread(target=p.follow) for p in publishers]
        for thread in threads:
            thread.start()
        yield publishers
        for publisher in publishers:
            publisher.stop()
        for thread in threads:
            thread.join()


def caught_up(publishers: list[Publisher], robots: tuple[SemanticMap, ...]) -> bool:
    return all(p.acknowledged == r.sequence for p, r in zip(publishers, robots, strict=True))


def test_two_robots_that_map_are_one_question(live, robots, url):
    def drive(robot: SemanticMap) -> None:
        for step in range(10):
            see(robot, "cup", 1.0 + step)
            see(robot, "chair", 1.0 + step, number=2)

    drivers = [threading.Thread(target=drive, args=(robot,)) for robot in robots]
    for driver in drivers:
        driver.start()
    for driver in drivers:
        driver.join()
    until(lambda: caught_up(live, robots), "the mirror never caught up")
    assert published(url) == own(robots[0].engine) | own(robots[1].engine)
    with open_map(url, read_only=True) as mirror:
        for question, parameters in (
            ("objects-by-category", {"category": "cup"}),
            ("objects", {}),
            ("places", {}),
        ):
            answers = [robot.query(question, **parameters) for robot in robots]
            rows = [row for answer in answers for row in answer.rows]
            assert sorted(mirror.query(question, **parameters).rows, key=str) == sorted(
                rows, key=str
            )
        near = "SELECT ?a ?b { ?a a here:Cup ; here:x ?x . ?b a here:Chair ; here:x ?x }"
        joined = {(str(a), str(b)) for a, b in mirror.query(near).rows}
        assert any(a.startswith(NORTH) and b.startswith(SOUTH) for a, b in joined)


@both
def test_edits_corrections_and_restorations_are_mirrored(live, robots, url):
    north, south = robots
    number = north.sequence
    north.assertions.add(f"{NORTH}object/1", "category", "bowl", by="ann")
    north.update('INSERT DATA { <http://example.org/mine> rdfs:comment "a \\"note\\"\\n" }')
    north.ontology.learn(["gramophone"], "object", model="net")
    south.update("DELETE WHERE { <object/2> ?p ?o }")
    until(lambda: caught_up(live, robots), "the mirror never caught up")
    assert published(url) == own(north.engine) | own(south.engine)
    north.restore(number)
    until(lambda: caught_up(live, robots), "the mirror never caught up")
    assert published(url) == own(north.engine) | own(south.engine)


def test_it_continues_behind_the_last_transaction_that_was_acknowledged(robots, url):
    north, south = robots
    target = PublishTarget(url)
    lines: list[str] = []
    with MapServer(north, SMALL) as server:
        first = Publisher(server.url, target)
        assert first.publish() == north.sequence
        see(north, "cup", 3.0)
        again = Publisher(server.url, target, lines.append)
        assert again.publish() == north.sequence == target.acknowledged(NORTH)
        assert lines == [f"north is published as of #{north.sequence}"], "no second snapshot"
        assert published(url) == own(north.engine)
    with MapServer(south, SMALL) as server:
        Publisher(server.url, target).publish()
    assert published(url) == own(north.engine) | own(south.engine)
    target.close()


def test_a_stale_copy_is_brought_up_to_date_without_touching_others(robots, url):
    north, south = robots
    target = PublishTarget(url)
    with MapServer(south, SMALL) as server:
        Publisher(server.url, target).publish()
    with MapServer(north, SMALL) as server:
        north.update('INSERT DATA { <http://example.org/mine> rdfs:comment "note" }')
        Publisher(server.url, target).publish()
        north.update("DELETE WHERE { <http://example.org/mine> ?p ?o }")
        north.update("DELETE WHERE { <object/1> ?p ?o }")
        see(north, "banana", 4.0)
        north.history.compact(keep=0.0)  # what came since is not kept
        Publisher(server.url, target).publish()
    assert published(url) == own(north.engine) | own(south.engine)
    assert target.acknowledged(NORTH) == north.sequence
    target.close()


@both
def test_a_large_map_goes_in_parts_and_a_part_alone_is_no_copy(robots, url, monkeypatch):
    monkeypatch.setattr("kg.serving.publishing.CHUNK", 25)
    monkeypatch.setattr("kg.serving.publishing.CHUNK_OF_VIRTUOSO", 1000)
    north, _ = robots
    for step in range(100):
        see(north, "cup", float(step))
    target = PublishTarget(url)
    with MapServer(north, SMALL) as server:
        Publisher(server.url, target).publish()
        assert published(url) == own(north.engine)
    target.close()


def test_maps_that_cannot_be_told_apart_are_refused(url: str) -> None:
    target = PublishTarget(url)
    with ExitStack() as running:
        for base in ("https://example.org/flat/", "https://example.org/flat/kitchen/"):
            made = running.enter_context(in_memory_map(base=base))
            server = running.enter_context(MapServer(made, SMALL))
            if base.endswith("flat/"):
                Publisher(server.url, target).publish()
            else:
                with pytest.raises(GraphError, match="cannot be distinguished"):
                    Publisher(server.url, target).publish()
    target.close()


def publish_command(source: str, url: str, *words: str) -> subprocess.Popen[bytes]:
    command = [*HEREABOUTS, "publish", source, "--to", url, *words]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL)


def _settled(target: PublishTarget, url: str) -> tuple[int, set[Quad]]:
    """Number and quads of one state: the last update of who was killed may still be under way."""
    while True:
        number, quads = target.acknowledged(NORTH), published(url)
        if number is not None and number == target.acknowledged(NORTH):
            return number, quads


def test_a_publisher_that_is_killed_leaves_exactly_what_was_acknowledged(tmp_path, url):
    rng = random.Random(5)
    target = PublishTarget(url)
    with create_map(tmp_path / "north.map", base=NORTH) as north:
        see(north, "chair", 1.0)
        with MapServer(north, SMALL) as server:
            for _ in range(3):
                process = publish_command(server.url, url)
                reached = target.acknowledged(NORTH) or 0
                until(lambda: (target.acknowledged(NORTH) or 0) > reached or process.poll(), "none")  # noqa: B023
                for step in range(rng.randrange(5, 30)):
                    see(north, "cup", float(step))
                process.kill()
                process.wait()
                number, quads = _settled(target, url)
                assert number <= north.sequence
                with north.at(number) as then:
                    assert quads == own(then.engine), f"not the state of #{number}"
                see(north, "banana", 2.0)
            Publisher(server.url, target).publish()
            assert published(url) == own(north.engine)
    target.close()


def test_a_folder_is_published_by_the_command_and_followed_until_it_is_told_to_end(
    tmp_path: Path, url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "north.map"
    with create_map(path, base=NORTH) as north:
        see(north, "cup", 1.0)
    assert main(["publish", str(path), "--to", url, "--once"]) == 0
    with open_map(path) as north:
        assert published(url) == own(north.engine)
        with MapServer(north, SMALL) as server:
            process = publish_command(server.url, url)
            see(north, "chair", 2.0)
            target = PublishTarget(url)
            until(lambda: target.acknowledged(NORTH) == north.sequence, "not followed")
            target.close()
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE) == 0
    assert main(["publish", str(tmp_path / "gone.map"), "--to", url, "--once"]) == 1
    assert "no map at" in capsys.readouterr().err
