"""Make the pictures of docs/pictures again: of the demo, a recorded kitchen, pages in a browser.

    python docs/make_pictures.py               all of them
    python docs/make_pictures.py demo map-page some of them

The kitchen is redkitchen of the 7-Scenes data set, the living room is of ICL-NUIM, the lounge of
HoloLens: in ../shared or HEREABOUTS_SHARED as for the tests. Pages are taken by Chromium with
Playwright. rviz.png is made by the commands of docs/how-to/viewers.md with Debian 12's
ros-core, python3-rosbag, rviz, xvfb and imagemagick: roscore, Xvfb
:77 -screen 0 1200x800x24 -nocursor, and DISPLAY=:77 import -window root -resize 960x640
-colors 48 rviz.png.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PIL import Image

from kg.serving.opening import open_map
from kg.serving.server import MapServer, Settings
from planner.questions.answers import answer_box

if TYPE_CHECKING:
    from playwright.sync_api import Page

GROWTH: Final = 40  # moments of the moving picture
PAUSES: Final = {"first": 700, "next": 130, "last": 2600}  # [ms] of its frames
DRAG: Final = """step => { const time = document.getElementById("time");
    time.value = step;
    time.dispatchEvent(new Event("input")); }"""
ROOT: Final = Path(__file__).resolve().parent.parent
PICTURES: Final = ROOT / "docs" / "pictures"
SIZE: Final = (1300, 860)


def main() -> None:
    """Make the chosen pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(MAKERS)}")
    names = parser.parse_args().names or list(MAKERS)
    if unknown := set(names) - set(MAKERS):
        parser.error(f"no picture {', '.join(unknown)}; there are: {', '.join(MAKERS)}")
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            picture = PICTURES / f"{name}.{'webp' if name == 'growing' else 'png'}"
            MAKERS[name](Path(folder), picture)
            if picture.suffix == ".png":
                shrink(picture)
            sys.stderr.write(f"wrote {picture}\n")


def shrink(picture: Path) -> None:
    """Write it again in 256 colours, a third of the bytes."""
    few = Image.open(picture).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=3)
    few.save(picture, optimize=True)


def demo(folder: Path, picture: Path) -> None:
    """The picture that `hereabouts demo` leaves."""
    shutil.copyfile(demo_map(folder).with_name("map.png"), picture)


def kitchen_map(folder: Path, picture: Path) -> None:
    """The mapped kitchen."""
    hereabouts("plot", recorded("redkitchen", "kitchen", folder), "-o", picture)


def kitchen_banana(folder: Path, picture: Path) -> None:
    """Where to look for a banana in it."""
    path = recorded("redkitchen", "kitchen", folder)
    hereabouts("find", path, "banana", "--from", "0,0", "--worth", "0.004", "--picture", picture)


def map_page(folder: Path, picture: Path) -> None:
    """The live page of the demo's map with the answer to a question."""
    with opened(demo_map(folder)) as page:
        find_cup(page)
        page.click("#fit")
        settled(page).screenshot(path=picture)


def growing(folder: Path, picture: Path) -> None:
    """The demo's map as it grows, then the answer to a question: a moving picture."""
    from playwright.sync_api import TimeoutError  # where the surface is that of the moment before

    frames = []
    with opened(demo_map(folder), "#?solid=1", size=(1080, 600)) as page:
        page.wait_for_selector("#earlier:enabled")
        settled(page)
        for n in range(GROWTH):
            step = 10_000 * (n + 1) // GROWTH
            with suppress(TimeoutError), page.expect_response("**/surface*", timeout=3000):
                page.evaluate(DRAG, step)
            page.wait_for_selector("#past:not([aria-busy])")
            page.wait_for_timeout(500)
            page.wait_for_selector("#canvas[data-drawn=smoothly]")
            frames.append(page.screenshot())
        find_cup(page)
        page.click("#fit")
        page.mouse.move(1, 1)
        frames.append(settled(page).screenshot())
    images = [Image.open(BytesIO(frame)).convert("RGB").resize((810, 450)) for frame in frames]
    pauses = [PAUSES["first"], *[PAUSES["next"]] * (GROWTH - 2), PAUSES["first"], PAUSES["last"]]
    images[0].save(
        picture,
        save_all=True,
        append_images=images[1:],
        duration=pauses,
        loop=0,
        quality=60,
        method=6,
    )


def thing_page(folder: Path, picture: Path) -> None:
    """The page of a thing of the demo."""
    with opened(demo_map(folder), "object/9", size=(1100, 760)) as page:
        page.wait_for_selector("#about-history li")
        settled(page).screenshot(path=picture)


def map_3d(folder: Path, picture: Path) -> None:
    """The same in three dimensions, with something selected."""
    with opened(demo_map(folder), "#object/39?solid=1") as page:
        page.click("#fit")
        settled(page).screenshot(path=picture)


def kitchen_page(folder: Path, picture: Path) -> None:
    """The live page of the kitchen's map with the plan of a search."""
    with opened(recorded("redkitchen", "kitchen", folder), size=(1100, 580)) as page:
        find_cup(page)
        page.click("#fit")
        settled(page).screenshot(path=picture)


def kitchen_3d(folder: Path, picture: Path) -> None:
    """The surface of the kitchen with its boxes, in three dimensions."""
    with opened(recorded("redkitchen", "kitchen", folder), "#?solid=1", size=(1300, 720)) as page:
        settled(page).screenshot(path=picture)


def living_room(folder: Path, picture: Path) -> None:
    """A rendered living room in three dimensions."""
    with opened(
        recorded("icl_livingroom", "living", folder), "#?solid=1", size=(1300, 720)
    ) as page:
        settled(page).screenshot(path=picture)


def lounge(folder: Path, picture: Path) -> None:
    """A lounge that a headset recorded, in three dimensions."""
    with opened(recorded("hololens_lounge", "lounge", folder), "#?solid=1") as page:
        settled(page).screenshot(path=picture)


def focus(folder: Path, picture: Path) -> None:
    """The kitchen's table alone."""
    with opened(recorded("redkitchen", "kitchen", folder), "#?solid=1", size=(1300, 720)) as page:
        page.click("text=All objects")
        page.click("#objects button:has-text('dining table') >> nth=0")
        page.click("#focus")
        settled(page).screenshot(path=picture)


def compare(folder: Path, picture: Path) -> None:
    """Two moments of the kitchen compared, on the axis of time."""
    with opened(recorded("redkitchen", "kitchen", folder), size=(1300, 720)) as page:
        page.wait_for_selector("#earlier:enabled")
        page.locator("#time").fill("5000")
        page.wait_for_selector("#now:enabled")
        page.click("#compare")
        page.wait_for_selector("#changes h2")
        page.click("#now")
        page.wait_for_selector("#changes h3")
        settled(page).screenshot(path=picture)


def settled(page: Page) -> Page:
    """The page once its surface and pictures have come, and its map is drawn."""
    page.wait_for_timeout(5000)  # the feed of changes never ends, so that the network is never idle
    page.wait_for_selector("#canvas[data-drawn=smoothly]")
    return page


def find_cup(page: Page) -> None:
    """Have the page plan a search."""
    page.fill("#wanted", "where is the cup?")
    page.press("#wanted", "Enter")
    page.wait_for_selector("#plan ol li", state="attached")
    page.wait_for_timeout(500)


def console(folder: Path, picture: Path) -> None:
    """The console with a shipped question, its parameter and its answer."""
    with opened(demo_map(folder), "console") as page:
        page.click("#questions >> text=objects-by-category")
        page.fill("#question input[name=category]", "chair")
        page.click("#question button:has-text('Ask')")
        page.wait_for_selector("#table tbody tr")
        page.screenshot(path=picture)


MAKERS: Final[dict[str, Callable[[Path, Path], None]]] = {
    "demo": demo,
    "kitchen-map": kitchen_map,
    "kitchen-banana": kitchen_banana,
    "kitchen-page": kitchen_page,
    "kitchen-3d": kitchen_3d,
    "map-page": map_page,
    "growing": growing,
    "map-3d": map_3d,
    "thing-page": thing_page,
    "living-room": living_room,
    "lounge": lounge,
    "focus": focus,
    "compare": compare,
    "console": console,
}


@cache
def demo_map(folder: Path) -> Path:
    """The demo's map."""
    hereabouts("demo", "--folder", folder)
    return folder / "demo.map"


@cache
def recorded(recording: str, name: str, folder: Path) -> Path:
    """The map of a recording, whose place gets a name."""
    shared = Path(os.environ.get("HEREABOUTS_SHARED", ROOT.parent / "shared"))
    source = folder / name
    source.mkdir()
    for file in (shared / "data" / "rgbd" / recording).iterdir():
        (source / file.name).symlink_to(file)
    hereabouts("map", source, "--into", folder / f"{name}.map")
    return folder / f"{name}.map"


def hereabouts(*words: object) -> None:
    """Run a command of the package; its output goes nowhere."""
    command = [sys.executable, "-m", "hereabouts.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@contextmanager
def opened(path: Path, address: str = "", size: tuple[int, int] = SIZE) -> Iterator[Page]:
    """A page of a served map once it is ready."""
    from playwright.sync_api import sync_playwright

    with open_map(path, read_only=True) as semantic_map, sync_playwright() as playwright:
        planner = partial(answer_box, semantic_map)
        with MapServer(semantic_map, Settings(port=0), planner=planner) as server:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"),
                args=[
                    "--no-sandbox",
                    "--use-gl=angle",
                    "--use-angle=swiftshader",
                    "--enable-unsafe-swiftshader",
                ],
            )
            page = browser.new_page(viewport={"width": size[0], "height": size[1]})
            page.goto(f"{server.url}{address}")
            page.wait_for_selector("html[data-ready]")
            yield page
            browser.close()


if __name__ == "__main__":
    main()
