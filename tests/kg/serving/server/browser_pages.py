"""Pages in a real browser: how tests open them and wait for what they say."""

import shutil
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

PATIENCE = 120_000  # [ms] for what comes at once, on a machine however slow
HOSTILE = '<img src=x onerror="alert(1)">'
CHROMIUM = shutil.which("chromium")
#: arguments of the browser: it draws in software; without the last ones it asks its makers' hosts
ARGUMENTS = (
    *(
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ),  # drawn in software
    *("--no-sandbox", "--no-first-run"),
    *(
        f"--disable-{name}"
        for name in ("background-networking", "component-update", "sync", "quic", "gpu")
    ),
)
#: [px] as small as leaves the margins of the map as they are: it is drawn in software
VIEWPORT = {"width": 1120, "height": 640}
#: whether the map is at rest now; `isAtRest` tells whether it stayed so since
WATCH = """() => {
    const changed = new MutationObserver(() => { window.isAtRest = false; changed.disconnect(); });
    changed.observe(canvas, { attributeFilter: ["data-drawn"] });
    return window.isAtRest = canvas.dataset.drawn === "smoothly";
}"""
OpenPage = Callable[..., Any]


def says(page: Any, selector: str, text: str) -> None:
    """Wait until an element has the text."""
    from playwright.sync_api import expect

    expect(page.locator(selector)).to_contain_text(text, timeout=PATIENCE)


def open_menu(page: Any, name: str) -> None:
    """Open a menu of the map: layers or more."""
    page.click(f"#{name} > summary")


def show_layer(page: Any, name: str, is_shown: bool) -> None:
    """Show or hide a layer of the map; its menu is closed again, and the pointer away."""
    open_menu(page, "layers")
    page.set_checked(f"[data-layer={name}]", is_shown)
    page.keyboard.press("Escape")
    page.mouse.move(1, 1)


def ask(page: Any, question: str) -> None:
    """Ask a question on the map, and wait for the answer's head."""
    page.fill("#wanted", question)
    page.press("#wanted", "Enter")
    page.wait_for_selector("#plan h2")


def unlock(page: Any, token: str) -> None:
    """Begin to edit with a token."""
    page.click("#edit")
    page.fill("#token", token)
    page.click("#corrector button")


def go_to(page: Any, address: str) -> None:
    """Follow an address within the page."""
    page.evaluate("address => { location.hash = address; }", address)


def click_map(page: Any, right: float = 0.0, up: float = 0.0) -> None:
    """Click on the map, so many pixels from its middle."""
    box = page.locator("#canvas").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 - up)


def picture(page: Any) -> Any:
    """The map as it looks at rest, (H, W, 3) uint8 BGR; taken again if it was drawn meanwhile."""
    while True:
        page.wait_for_selector("#canvas[data-drawn=smoothly]")
        if page.evaluate(WATCH):
            data = np.frombuffer(page.locator("#canvas").screenshot(), np.uint8)
            if page.evaluate("isAtRest"):
                return cv2.imdecode(data, cv2.IMREAD_COLOR)


def picture_where(page: Any, condition: Callable[[Any], Any]) -> Any:
    """The map at rest, as soon as its picture fulfils a condition."""
    end = time.monotonic() + PATIENCE / 1000
    while not condition(now := picture(page)):
        assert time.monotonic() < end, "the map was not drawn so"
        page.wait_for_timeout(50)  # until the next change is drawn
    return now


def other_picture(page: Any, before: Any) -> Any:
    """The map at rest, as soon as it does not look as before."""
    return picture_where(page, lambda now: not np.array_equal(now, before))


def same_picture(page: Any, before: Any) -> None:
    """Wait until the map looks as before."""
    picture_where(page, lambda now: np.array_equal(now, before))


def has_violet(image: Any) -> bool:
    """Whether more than a hundred pixels of a picture are violet."""
    blue, green, red = np.moveaxis(image, -1, 0)
    return int(((red > 150) & (blue > 150) & (green < 90)).sum()) > 100


def is_fault(message: Any) -> bool:
    """Whether a line of the browser's console is an error; a refusal (4xx) is the server's word."""
    return message.type == "error" and "responded with a status of 4" not in message.text


def faults(page: Any) -> list[tuple[str, list[str]]]:
    """Faults of accessibility that axe finds, with the elements."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found]
