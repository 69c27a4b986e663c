"""Rates of `live` without poses: images a second that are tracked and mapped.

python -m benchmarks.live_rate ../shared/data/rgbd/redkitchen --rates 5 10 15

A server of the Foxglove SDK, in a process of its own, plays the recording forwards and backwards
at a rate, without poses. `hereabouts live` tracks the camera and maps by the bundled networks.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from benchmarks.recordings_in_the_wild.live import Sender
from benchmarks.recordings_in_the_wild.robot import BEGIN, Shot, record
from benchmarks.recordings_in_the_wild.trial import HEREABOUTS
from lab.command_line import parser_of
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

IDLE: Final = 8.0  # [s] after the last image when `live` ends
WAITED: Final = 10.0  # [s] in which `live` waits for poses and tracks nothing
READ_AHEAD: Final = 250  # images that are sent again and again


def main() -> None:
    """Print a row for each rate."""
    parser = parser_of("benchmarks.live_rate", __doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--rates", type=float, nargs="+", default=[10.0], help="images a second")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each rate")
    given = parser.parse_args()
    print("  sent tracked mapped  (a second)  with a pose   load")  # noqa: T201
    for rate in given.rates:
        print(row(given.recording, rate, given.seconds), flush=True)  # noqa: T201


def row(recording: Path, rate: float, seconds: float) -> str:
    """One line: images a second that were sent, tracked and mapped."""
    context = multiprocessing.get_context("spawn")
    ports = context.Queue()
    server = context.Process(target=serve, args=(recording, rate, seconds, ports), daemon=True)
    server.start()
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(
            [*HEREABOUTS, "live", f"ws://127.0.0.1:{ports.get()}", "--into", f"{scratch}/live.map",
             "--json", "--idle", str(IDLE)],
            capture_output=True, text=True,
        )  # fmt: skip
    server.terminate()
    if done.returncode:
        return f"{rate:6g} {done.stderr.strip().splitlines()[-1]}"
    counts: dict[str, Any] = json.loads(done.stdout)
    images = counts["tracked"] + counts["lost"]
    a_second = rate / (counts["received"] - WAITED * rate)
    return (
        f"{rate:6g} {images * a_second:7.1f} {counts['frames'] * a_second:6.1f} "
        f"{counts['tracked'] / images:24.2f} {os.getloadavg()[0]:6.1f}"
    )


def serve(recording: Path, rate: float, seconds: float, ports: Any) -> None:
    """Send images at a rate, without poses, from the moment that somebody listens."""
    import foxglove

    opened = open_recording(str(recording), RecordingOptions(check=False))
    made = [
        Shot(BEGIN, frame.rgb, frame.depth, frame.K, frame.T_map_cam)
        for _, frame in zip(range(READ_AHEAD), opened.frames(), strict=False)
    ]
    there_and_back = made + made[-2:0:-1]
    server = foxglove.start_server(host="127.0.0.1", port=0, context=(c := foxglove.Context()))
    sender = Sender("cdr", c)
    ports.put(server.port)
    began, number = time.monotonic(), 0
    while (now := time.monotonic() - began) < WAITED + seconds:
        time.sleep(max(0.0, number / rate - now))
        shot = there_and_back[number % len(there_and_back)]
        stamp = BEGIN + int(1e9 * number / rate)
        for message in record([Shot(stamp, shot.rgb, shot.depth, shot.K, shot.T_map_cam)]):
            if not message.topic.startswith("/tf"):
                sender.send(message)
        number += 1
    time.sleep(2 * IDLE)


if __name__ == "__main__":
    main()
