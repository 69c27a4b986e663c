"""Whether followers of the feed slow the mapper: `python -m benchmarks.feed [--followers N]`.

Serves a map of 1,000 objects in this process, as `hereabouts serve --recording` does, and writes 30
changes a second into it, each of 5 objects (`--changed`), then as many as it can: alone, and with N
followers in another process, each of an address of its own, on `/changes`. Twice each, in turns.
Prints a table in Markdown: changes a second, milliseconds a change (of the clock, and of this
process' processor time with all that serving takes), seconds from the last change until all
followers have it, followers dropped.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import sys
import time
from multiprocessing.connection import Connection
from urllib.parse import urlsplit

import numpy as np

from benchmarks.map_page import filled
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from kg.serving.server import MapServer, Settings
from lab.command_line import parser_of

SECONDS = 10.0  # of each row


def write_on(
    semantic_map: SemanticMap, objects: list[ObjectRecord], changed: int, rate: float
) -> tuple[int, float, list[float]]:
    """Write for a while: changes made, when the last one was [s], and the time of each [s]."""
    times: list[float] = []
    ended = 0.0
    started = time.perf_counter()
    while (begun := time.perf_counter()) < started + SECONDS:
        moved = [objects[(len(times) * changed + n) % len(objects)] for n in range(changed)]
        for one in moved:
            one.p_map[0] += 0.1
        semantic_map.apply(MapUpdate(objects=tuple(moved)))
        times.append(time.perf_counter() - begun)
        ended = time.time()
        time.sleep(max(0.0, started + len(times) / rate - time.perf_counter()))
    return len(times), ended, times


async def follow(url: str, number: int) -> list[tuple[float, int]]:
    """When [s] a client had which change, until the server hangs up."""
    whole = urlsplit(url)
    address = (f"127.0.{1 + number // 200}.{1 + number % 200}", 0)
    reader, writer = await asyncio.open_connection(
        whole.hostname, whole.port, local_addr=address, limit=1 << 24
    )
    head = f"GET /changes HTTP/1.1\r\nHost: {whole.netloc}\r\nAccept: text/event-stream\r\n\r\n"
    writer.write(head.encode())
    had = []
    try:
        while line := await reader.readline():
            if line.startswith(b"id: "):
                had.append((time.time(), int(line[4:])))
    except (ConnectionError, asyncio.CancelledError):
        pass
    writer.close()
    return had


def followers(url: str, count: int, pipe: Connection) -> None:
    """`count` clients, until the pipe says that it is enough; sends what each had last."""

    async def all_of_them() -> None:
        clients = [asyncio.ensure_future(follow(url, number)) for number in range(count)]
        await asyncio.get_running_loop().run_in_executor(None, pipe.recv)
        for client in clients:
            client.cancel()
        pipe.send([had[-1] if had else (0.0, 0) for had in await asyncio.gather(*clients)])

    asyncio.run(all_of_them())


def row(
    server: MapServer, objects: list[ObjectRecord], changed: int, count: int, rate: float
) -> str:
    """One row of the table."""
    semantic_map, feed = server.serving.semantic_map, server.serving.feed
    ours, theirs = multiprocessing.Pipe()
    crowd = multiprocessing.get_context("spawn").Process(
        target=followers, args=(server.url, count, theirs)
    )
    dropped = feed.dropped
    if count:
        crowd.start()
        while feed.followers < count:
            time.sleep(0.1)
    processor = time.process_time()
    made, ended, times = write_on(semantic_map, objects, changed, rate)
    processor = (time.process_time() - processor) * 1000 / made
    behind = "-"
    if count:
        time.sleep(5.0)
        ours.send("enough")
        last = ours.recv()
        crowd.join()
        complete = [when for when, sequence in last if sequence == semantic_map.sequence]
        behind = f"{max(complete, default=np.nan) - ended:.2f}"
    p50, p95 = np.percentile(times, [50, 95]) * 1000
    wanted = f"{rate:.0f}" if np.isfinite(rate) else "most"
    cells = (
        count,
        wanted,
        f"{made / SECONDS:.1f}",
        f"{p50:.1f}",
        f"{p95:.1f}",
        f"{processor:.1f}",
        behind,
    )
    return "| " + " | ".join(map(str, (*cells, feed.dropped - dropped))) + " |\n"


def main() -> None:
    """Serve, write, follow."""
    parser = parser_of("benchmarks.feed", __doc__)
    parser.add_argument("--followers", type=int, default=100)
    parser.add_argument("--changed", type=int, default=5, help="objects of one change")
    given = parser.parse_args()
    head = "followers, wanted, changes/s, median ms, p95 ms, processor ms, behind s, dropped"
    sys.stdout.write(f"| {head.replace(',', ' |')} |\n{'|---' * 8}|\n")
    with in_memory_map(title="hall", base="https://example.org/hall/") as semantic_map:
        objects = filled(semantic_map, 1000)
        with MapServer(semantic_map, Settings(port=0)) as server:
            for rate in (30.0, np.inf):
                for number in (0, given.followers) * 2:
                    sys.stdout.write(row(server, objects, given.changed, number, rate))
                    sys.stdout.flush()


if __name__ == "__main__":
    main()
