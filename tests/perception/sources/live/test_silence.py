"""A live recording whose images, depth or poses dry up and return: one line each, over the wire."""

import re
import threading
import time

import pytest

pytest.importorskip("websockets")
from perception.sources.bag_writer import COLOUR, DEPTH
from perception.sources.live import silence, stream
from perception.sources.live.foxglove import FoxgloveConnection
from perception.sources.live.live_recording import LiveRecording
from perception.sources.live.stream import FrameStream
from tests.perception.sources.live.foxglove_peer import foxglove_peer
from tests.perception.sources.live.test_stream import moved
from tests.waiting import until

ALWAYS = ("/tf_static", "/hereabouts/recording")


@pytest.mark.parametrize(
    ("topic", "said"),
    [
        (COLOUR, rf"no frames: no colour images of {COLOUR} for \d+ s"),
        (DEPTH, rf"no frames: no depth images of {DEPTH} for \d+ s"),
        ("/tf", r"no frames: no poses: the last transform of camera\w* in world \(tf\) is "
                r"\d+\.\d s older than the newest image, at \d+\.\d{3}"),
    ],
)  # fmt: skip
def test_what_dried_up_is_told_once_and_once_that_it_returned(
    messages, monkeypatch, caplog, topic, said
):
    monkeypatch.setattr(silence, "DRY", 0.5)
    monkeypatch.setattr(stream, "SETTLING", 0.1)
    raws, ended, missing = messages(".bag"), threading.Event(), threading.Event()
    with foxglove_peer({raw.topic: raw.type for raw in raws}, "ros1") as peer:

        def play() -> None:
            number = 0
            while not ended.is_set():
                for raw in raws:
                    if not (missing.is_set() and raw.topic == topic):
                        later = raw if raw.topic in ALWAYS else moved(raw, number)
                        peer.publish(later)
                    if raw.topic == DEPTH and ended.wait(0.05):
                        return
                number += 1

        made = FrameStream(peer.address)
        recording = LiveRecording("live", FoxgloveConnection.at(peer.address), made, ended)
        player = threading.Thread(target=play)
        player.start()
        mapper = threading.Thread(target=lambda: list(recording.frames()))
        mapper.start()
        try:
            until(lambda: made.counts.taken > 2)
            caplog.clear()
            missing.set()
            until(lambda: "no frames" in caplog.text)
            time.sleep(1)
            missing.clear()
            until(lambda: "frames come again, after" in caplog.text)
        finally:
            ended.set()
            player.join()
            mapper.join()
    lines = [r.getMessage() for r in caplog.records if "frames" in r.getMessage()]
    assert len(lines) == 2
    assert re.search(said, lines[0]), lines[0]
