"""Trials of `live`: a server of the Foxglove SDK sends the frames, and the map is compared."""

from __future__ import annotations

import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.recordings_in_the_wild import containers as to
from benchmarks.recordings_in_the_wild.kind import Kind
from benchmarks.recordings_in_the_wild.robot import COLOUR, Message, Messages, record
from benchmarks.recordings_in_the_wild.trial import (
    BELIEVED,
    HEREABOUTS,
    MAP,
    Outcome,
    Plain,
    detections_file,
    opened,
    things,
)

FRAMES = 16  # by which a stream is levelled, so that bag and stream make one map
PAUSE = 0.1  # [s] between two frames
HEIGHT, PLACE = 0.15, 0.5  # [m] of a thing, where the stream has dropped some frames


def live_trial(kind: Kind, true: Plain, scratch: Path) -> Outcome:
    """Send frames while `live` maps them; things must be where the bag's map has them."""
    messages = record(true.shots[:FRAMES])
    path = to.mcap_ros2(messages, scratch)
    recording = opened(path, ())
    found = detections_file(scratch / "d.json", recording, true.shots, true.detections)
    words = ["--detector", str(found), *MAP]
    by_map, by_live = scratch / "bag.map", scratch / "live.map"
    subprocess.run(
        [*HEREABOUTS, "map", str(path), "--into", str(by_map), *words],
        check=True, capture_output=True,
    )  # fmt: skip
    code, said = _sent(kind.live, messages, by_live, words)
    lines = said.strip().splitlines()
    if code:
        return Outcome(kind.name, f"REFUSED ({code})", lines[-1] if lines else "")
    wanted, made = things(by_map), things(by_live)
    wrong = _elsewhere(wanted, made)
    return Outcome(kind.name, f"SILENTLY WRONG: {wrong}" if wrong else "right", "")


def _elsewhere(wanted: list[dict[str, Any]], made: list[dict[str, Any]]) -> str:
    """Things of the bag's map that the stream's map, of perhaps fewer frames, has elsewhere."""
    if not made:
        return "an empty map"
    apart = []
    for one in made:
        if one["existence"] < BELIEVED:
            continue
        same = [o for o in wanted if o["category"] == one["category"]]
        off = [np.abs([one[x] - o[x] for x in "xyz"]) for o in same]
        if not any(d[2] < HEIGHT and max(d[:2]) < PLACE for d in off):
            apart.append(one["category"])
    return ", ".join(apart)


def _sent(encoding: str, messages: Messages, into: Path, words: list[str]) -> tuple[int, str]:
    """Exit code and stderr of `live` while a server sends the messages again and again."""
    import foxglove

    server = foxglove.start_server(host="127.0.0.1", port=0, context=(c := foxglove.Context()))
    send = Sender(encoding, c)
    ended = threading.Event()

    def play() -> None:
        while not ended.is_set():
            for message in messages:
                send.send(message)
                if message.topic == COLOUR and ended.wait(PAUSE):
                    return
            time.sleep(PAUSE)

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    limit = ("--limit", str(FRAMES), "--idle", "20")
    command = [*HEREABOUTS, "live", f"ws://127.0.0.1:{server.port}", "--into", str(into)]
    try:
        done = subprocess.run(
            [*command, *limit, *words], capture_output=True, text=True, timeout=200
        )
        return done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        return 124, "timeout"
    finally:
        ended.set()
        thread.join()
        server.stop()


class Sender:
    """Channels of a server, by topic."""

    def __init__(self, encoding: str, context: Any) -> None:
        self._encoding, self._context = encoding, context
        self._channels: dict[str, Any] = {}

    def send(self, message: Message) -> None:
        """Send a message in the encoding."""
        from foxglove import Channel, Schema

        if self._encoding in ("protobuf", "json"):
            said = to.foxglove(message)
            if said is None:
                return
            built = to.protobuf(*said)
            name = f"foxglove.{said[0]}"
            if self._encoding == "json":
                data = to.as_json(*said)
                schema = Schema(name=name, encoding="jsonschema", data=b'{"type": "object"}')
            else:
                data = built.SerializeToString()
                schema = Schema(name=name, encoding="protobuf", data=b"")
        else:
            types = to.ROS1 if self._encoding == "ros1" else to.ROS2
            data = to.encoded(types, message)
            name = message.type.replace("/msg/", "/") if types is to.ROS1 else message.type
            schema = Schema(name=name, encoding=f"ros{1 + (types is to.ROS2)}msg", data=b"")
        if message.topic not in self._channels:
            self._channels[message.topic] = Channel(
                message.topic,
                message_encoding=self._encoding,
                schema=schema,
                context=self._context,
            )
        self._channels[message.topic].log(data)
