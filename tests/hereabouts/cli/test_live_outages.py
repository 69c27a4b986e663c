"""`hereabouts live` into a served map: its server is killed and comes back."""

import json
import re
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from hereabouts.cli import main
from hereabouts.cli.live_outages import MappedFrames, through_outages
from kg.model.errors import MapBusyError, RemoteError, UnreachableError
from perception.sources.live import connection
from tests.hereabouts.cli.test_serve import Process, home, serve, tokens
from tests.hereabouts.cli.test_served_maps import applied, start, token, trusted, until

__all__ = ["home", "serve", "token", "tokens"]  # fixtures

Serve = Callable[..., Process]


def restarted(process: Process, path: Path, tokens: Path) -> subprocess.Popen[bytes]:
    """Kill a server, and start another one at its address a while later."""
    process.popen.kill()
    process.popen.communicate()
    time.sleep(1)
    port = str(urlsplit(process.url).port)
    return start("serve", path, "--token-file", tokens, "--port", port)


def until_answered(url: str) -> int:
    """Frames that the map holds, once its server answers."""
    import requests

    end = time.monotonic() + 60
    while True:
        try:
            return applied(url)
        except requests.RequestException:
            assert time.monotonic() < end
            time.sleep(0.1)


def ended(server: subprocess.Popen[bytes]) -> None:
    server.terminate()
    server.communicate(timeout=60)


def test_a_growing_folder_is_mapped_whole_over_a_restart_of_the_server(
    serve: Serve, kitchen: Path, home: Path, tokens: Path
) -> None:
    process = trusted(serve(home, "--token-file", tokens))
    words = ("--scene", "none", "--limit", 8, "--idle", 5, "--json")
    live = start("live", kitchen, "--into", process.url, *words)
    until(process.url, 2, live)
    acknowledged = applied(process.url)
    server = restarted(process, home, tokens)
    try:
        assert until_answered(process.url) >= acknowledged
        out, err = live.communicate(timeout=120)
        assert live.returncode == 0, err.decode()
        assert applied(process.url) == 8
        # of one frame it may not have heard that it is in the map
        assert json.loads(out)["frames"] in (7, 8)
        assert re.search(r"http://\S+: .*(answer|broke off).*; trying again", err.decode())
    finally:
        ended(server)
    assert main(["check", str(home)]) == 0


def test_a_stream_goes_on_after_a_restart_of_the_server(serve, kitchen, home, tokens, tmp_path):
    pytest.importorskip("rosbags")
    pytest.importorskip("websockets")
    from perception.sources.bag_writer import DEPTH
    from perception.sources.bags.bag_file import BagFile
    from tests.perception.sources.live.foxglove_peer import foxglove_peer

    assert main(["convert", str(kitchen), "-o", str(tmp_path / "kitchen.mcap")]) == 0
    with BagFile(tmp_path / "kitchen.mcap") as bag:
        raws = list(bag.messages([topic.name for topic in bag.topics]))
    process = trusted(serve(home, "--token-file", tokens))
    with foxglove_peer({raw.topic: raw.type for raw in raws}, "cdr") as peer:
        words = ("--scene", "none", "--limit", 8, "--json", "--into", process.url)
        live = start("live", peer.address, *words)

        def play(enough: Callable[[], bool]) -> None:
            while not enough():
                for raw in raws:
                    peer.publish(raw)
                    if raw.topic == DEPTH:
                        time.sleep(0.1)

        play(lambda: live.poll() is not None or applied(process.url) >= 2)
        acknowledged = applied(process.url)
        server = restarted(process, home, tokens)
        try:
            assert until_answered(process.url) >= acknowledged
            play(lambda: live.poll() is not None)
            out, err = live.communicate(timeout=120)
            assert live.returncode == 0, err.decode()
            report = json.loads(out)
            assert report["frames"] == 8
            assert applied(process.url) - 8 in (0, 1)
            lost = [report[k] for k in ("dropped", "without_depth", "without_pose", "unreadable")]
            assert report["received"] == 8 + sum(lost)
        finally:
            ended(server)
    assert main(["check", str(home)]) == 0


def test_a_server_that_was_never_there_is_an_error(kitchen, fails):
    words = ("--scene", "none", "--idle", 5)
    assert "127.0.0.1:1" in fails("live", kitchen, "--into", "http://127.0.0.1:1/", *words)


AWAY, REFUSED = UnreachableError("nobody answers"), RemoteError("broke off its answer")
BUSY = MapBusyError("somebody else maps")


@pytest.mark.parametrize(
    ("opened", "happens", "raised"),
    [
        (False, [AWAY], AWAY),  # it was never there
        (True, [AWAY, AWAY, "frame", AWAY, "frame"], None),
        (True, [REFUSED, AWAY, "frame", REFUSED, "frame"], None),
        (True, [REFUSED, REFUSED], REFUSED),
        (True, [BUSY], BUSY),  # another mapper
        (True, [AWAY, BUSY, "frame"], None),  # our own frame of before
        (True, [AWAY, BUSY, BUSY], BUSY),
    ],
)
def test_what_is_an_outage_and_what_an_error(monkeypatch, opened, happens, raised):
    monkeypatch.setattr(connection, "MIN_PAUSE", 0.001)
    mapped, left = MappedFrames(opened=opened), list(happens)

    def run() -> None:
        while left:
            now = left.pop(0)
            if now != "frame":
                raise now
            mapped.count += 1

    with pytest.raises(type(raised)) if raised else nullcontext():
        through_outages("http://here", threading.Event(), mapped, run)
    assert not left


def test_ended_during_an_outage_it_says_so() -> None:
    ended = threading.Event()

    def run() -> None:
        ended.set()
        raise AWAY

    with pytest.raises(UnreachableError):
        through_outages("http://here", ended, MappedFrames(opened=True), run)
