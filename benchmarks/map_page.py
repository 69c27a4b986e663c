"""Load of the live map's page: `python -m benchmarks.map_page [--objects N]`.

Serves a map of N objects, opens it in headless Chromium (software rendering) and prints: seconds to
the first picture, frames a second while dragging for five seconds (all of the map, near, where
objects are drawn one by one, and in three dimensions), how far the page is behind after 30 changes
a second for ten seconds.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from playwright.sync_api import JSHandle, Page, sync_playwright

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map
from kg.serving.server import MapServer, Settings
from lab.command_line import parser_of

TICKS = os.sysconf("SC_CLK_TCK")
QUIET = ("background-networking", "component-update", "sync", "quic", "gpu")
ARGUMENTS = (
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *(f"--disable-{name}" for name in QUIET),
)
ZOOM = "() => { for (let n = 0; n < 6; n++) document.getElementById('closer').click(); }"
PAN = """async (canvas) => {
  let frames = 0;
  const box = canvas.getBoundingClientRect(), ended = performance.now() + 5000;
  const send = (kind, x) => canvas.dispatchEvent(new PointerEvent(kind,
    { pointerId: 1, clientX: box.left + x, clientY: box.top + 200, bubbles: true }));
  canvas.setPointerCapture = () => {};
  send("pointerdown", 300);
  while (performance.now() < ended) {
    await new Promise((done) => requestAnimationFrame(done));
    send("pointermove", 300 + 200 * Math.sin(frames++ / 20));
    // as a hand that stops
    if (frames % 50 === 0) await new Promise((done) => setTimeout(done, 300));
  }
  send("pointerup", 300);
  return frames / 5;
}"""


def browser_seconds() -> float:
    """[s] of processor time that Chromium's processes under this one have used."""
    parents, used = dict[int, int](), dict[int, float]()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(fields[1])
            if b"chromium" in (folder / "cmdline").read_bytes():
                used[int(folder.name)] = (int(fields[11]) + int(fields[12])) / TICKS
    return sum(
        seconds for number, seconds in used.items() if is_under(os.getpid(), number, parents)
    )


def is_under(ancestor: int, number: int, parents: dict[int, int]) -> bool:
    """Whether a process descends from another."""
    while number in parents and number != ancestor:
        number = parents[number]
    return number == ancestor


def panned(canvas: JSHandle) -> tuple[float, float]:
    """Frames a second while panning, and [ms] of processor time of the browser for each."""
    before = browser_seconds()
    rate = float(canvas.evaluate(PAN))
    return rate, 1000 * (browser_seconds() - before) / (5 * rate)


def thing(
    semantic_map: SemanticMap, number: int, p_map: np.ndarray, labels: list[str]
) -> ObjectRecord:
    """An object of a category that its number gives."""
    return ObjectRecord(
        iri=f"{semantic_map.base}object/{number}",
        category=labels[number % len(labels)],
        p_map=p_map,
        confidence=2.4,
        existence=0.8,
        observations=3,
        first_seen=1.7e9,
        last_seen=1.7e9 + number,
        place=semantic_map.place_iri(1),
        extent=np.array([0.3, 0.2, 0.4]),
    )


def filled(semantic_map: SemanticMap, count: int) -> list[ObjectRecord]:
    """Objects all over a hall of one square metre each."""
    side = float(np.sqrt(count))
    labels = [c.iri for c in semantic_map.catalogue.categories if c.kind == "object"]
    hall = PlaceRecord(semantic_map.place_iri(1), "hall", 0, side, 0, side)
    places = np.random.default_rng(0).uniform(0, side, (count, 2))
    objects = [
        thing(semantic_map, n + 1, np.array([x, y, 0.8]), labels) for n, (x, y) in enumerate(places)
    ]
    for start in range(0, count, 500):
        update = MapUpdate(objects=tuple(objects[start : start + 500]), places=(hall,))
        semantic_map.apply(update)
    return objects


def behind(
    page: Page, semantic_map: SemanticMap, objects: list[ObjectRecord]
) -> tuple[float, float]:
    """Changes made a second, for ten seconds, and seconds until the page shows the last."""
    started, made = time.perf_counter(), 0
    while time.perf_counter() < started + 10:
        one = objects[made % len(objects)]
        one.p_map[0] += 0.1
        semantic_map.apply(MapUpdate(objects=(one,)))
        made += 1
        time.sleep(max(0.0, started + made / 30 - time.perf_counter()))
    ended = time.perf_counter()
    newest = f"#sequence:text('{semantic_map.sequence}')"
    page.wait_for_selector(newest, state="attached", timeout=60_000)
    return made / (ended - started), time.perf_counter() - ended


def main() -> None:
    """Serve, open, measure."""
    parser = parser_of("benchmarks.map_page", __doc__)
    parser.add_argument("--objects", type=int, default=10_000)
    count = parser.parse_args().objects
    with in_memory_map(title="hall", base="https://example.org/hall/") as semantic_map:
        objects = filled(semantic_map, count)
        with MapServer(semantic_map, Settings(port=0)) as server, sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"),
                args=list(ARGUMENTS),
            )
            page = browser.new_page(viewport={"width": 1300, "height": 900})
            started = time.perf_counter()
            page.goto(server.url)
            page.wait_for_selector("html[data-ready]", timeout=120_000)
            first = time.perf_counter() - started
            canvas = page.evaluate_handle("document.getElementById('canvas')")
            rate = panned(canvas)
            page.evaluate(ZOOM)
            near = panned(canvas)
            page.click("#fit")
            page.click("#solid")
            page.wait_for_timeout(1000)
            solid = panned(canvas)
            page.click("#solid")
            made, late = behind(page, semantic_map, objects)
            browser.close()
    sys.stdout.write(
        f"{count} objects: first picture after {first:.2f} s; {rate[0]:.0f} frames a second while "
        f"panning all ({rate[1]:.0f} ms of processor time each), "
        f"{near[0]:.0f} near ({near[1]:.0f} ms), {solid[0]:.1f} in three dimensions "
        f"({solid[1]:.0f} ms); {made:.0f} changes a second, "
        f"the page {late:.2f} s behind at their end\n"
    )


if __name__ == "__main__":
    main()
