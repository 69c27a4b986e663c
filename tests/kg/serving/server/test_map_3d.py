"""The live map in three dimensions, in a real browser that draws in software."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from kg.maps.surface.voxels import FrameVoxels, keys_of
from kg.model.records import FREE, TALL, FloorTile, MapUpdate, RobotRecord
from planner.search.plans.report import find_answer
from tests.kg.serving.server.browser_pages import HOSTILE, OpenPage, faults, says

if TYPE_CHECKING:
    from conftest import Served

    from kg.maps.semantic_map import SemanticMap

CANVAS = "#solid-canvas"


@pytest.fixture
def served(flat: SemanticMap, serve: Callable[..., Served]) -> Served:
    cells = np.full((32, 32), FREE, np.uint8)
    cells[0] = TALL
    tile = FloorTile(0, 0, 0, -1.3, 0.1, cells, 0.0)
    robot = RobotRecord(np.array([1.0, 1.0, 1.2]), 0.5, 10.0)
    flat.apply(MapUpdate(floor=(tile,), robot=robot))
    return serve(planner=partial(find_answer, flat))


@pytest.fixture
def solid(open_page: OpenPage) -> Any:
    """The page with its map in three dimensions."""
    page = open_page()
    page.click("#solid")
    page.wait_for_selector(CANVAS)
    drawn_otherwise(page, None)
    return page


def drawn_otherwise(page: Any, before: bytes | None) -> bytes:
    """The picture of the map as soon as it is another one than `before`, and rests."""
    last = before
    while True:
        page.wait_for_timeout(200)
        now = bytes(page.locator(CANVAS).screenshot())
        if now == last and now != before:
            return now
        last = now


def to(page: Any, address: str) -> None:
    page.evaluate("address => { location.hash = address; }", address)


@pytest.mark.parametrize(("address", "name"), [("#object/1", "cup 1"), ("#place/1", "kitchen")])
def test_a_click_on_a_box_or_a_floor_selects_what_it_is(
    solid: Any, address: str, name: str
) -> None:
    to(solid, address)
    says(solid, "#about h2", name)
    to(solid, "#")
    says(solid, "#about", "Nothing is selected")
    box = solid.locator(CANVAS).bounding_box()
    solid.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    says(solid, "#about h2", name)


def test_it_is_turned_by_mouse_and_keys_and_shows_all_again(solid: Any) -> None:
    first = drawn_otherwise(solid, None)
    box = solid.locator(CANVAS).bounding_box()
    solid.mouse.move(box["x"] + 200, box["y"] + 200)
    solid.mouse.down()
    solid.mouse.move(box["x"] + 320, box["y"] + 240)
    solid.mouse.up()
    turned = drawn_otherwise(solid, first)
    says(solid, "#about", "Nothing is selected")
    solid.focus(CANVAS)
    solid.keyboard.press("ArrowLeft")
    moved = drawn_otherwise(solid, turned)
    solid.keyboard.press("+")
    drawn_otherwise(solid, moved)
    solid.keyboard.press("0")
    assert drawn_otherwise(solid, moved) == first


def test_changes_filters_plans_and_the_past_are_drawn(served: Served, solid: Any) -> None:
    first = drawn_otherwise(solid, None)
    served.put(3, "bowl", 2.0, 2.0)
    more = drawn_otherwise(solid, first)
    solid.fill("#filter", "cup")
    fewer = drawn_otherwise(solid, more)
    solid.fill("#filter", "")
    drawn_otherwise(solid, fewer)
    solid.fill("#wanted", "cup")
    solid.press("#wanted", "Enter")
    solid.wait_for_selector("#plan ol li")
    planned = drawn_otherwise(solid, fewer)
    solid.locator("#time").fill("1")
    drawn_otherwise(solid, planned)


def test_names_of_anybody_are_text(served: Served, solid: Any) -> None:
    before = drawn_otherwise(solid, None)
    served.map.assertions.add(f"{served.map.base}object/1", "label", HOSTILE, by="ann")
    drawn_otherwise(solid, before)


def test_the_flat_map_comes_back(solid: Any) -> None:
    assert solid.locator("#canvas").is_hidden()
    assert solid.get_attribute("#solid", "aria-pressed") == "true"
    solid.click("#solid")
    assert solid.locator("#canvas").is_visible() and not solid.locator(CANVAS).count()
    solid.click("#solid")
    solid.wait_for_selector(CANVAS)


def test_without_webgl_the_map_stays_flat_and_says_so(open_page: OpenPage) -> None:
    page = open_page()
    page.evaluate("""() => {
        const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            return kind === "webgl2" ? null : get.call(this, kind, ...more); }; }""")
    page.click("#solid")
    says(page, "#status", "the map stays flat: this browser has no WebGL 2")
    assert page.locator("#canvas").is_visible()
    assert page.get_attribute("#solid", "aria-pressed") == "false"


def test_graphics_that_are_lost_leave_the_flat_map(solid: Any) -> None:
    solid.evaluate(
        "selector => document.querySelector(selector).getContext('webgl2')"
        ".getExtension('WEBGL_lose_context').loseContext()",
        CANVAS,
    )
    says(solid, "#status", "the map is flat again")
    assert solid.locator("#canvas").is_visible()


def test_nothing_of_it_is_loaded_before_it_is_opened(open_page: OpenPage) -> None:
    page = open_page()
    loaded = "() => performance.getEntriesByType('resource').map((one) => one.name).join()"
    assert "three" not in page.evaluate(loaded)
    page.click("#solid")
    page.wait_for_selector(CANVAS)
    assert "/files/vendor/three.min.js" in page.evaluate(loaded)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_has_no_serious_fault(open_page: OpenPage, scheme: str) -> None:
    pytest.importorskip("axe_playwright_python")
    page = open_page(color_scheme=scheme, bypass_csp=True)
    page.click("#solid")
    page.wait_for_selector(CANVAS)
    assert faults(page) == []


def test_the_surface_is_drawn_from_above_and_in_three_dimensions(
    served: Served, open_page: OpenPage
) -> None:
    store = served.map.surface_store
    assert store is not None
    store.begin(0.025)
    x, y = (axis.ravel() for axis in np.mgrid[20:70, 20:70])
    seen = np.sort(keys_of(np.stack([x, y, np.full_like(x, -20)])))
    violet = np.full((len(seen), 3), (200, 20, 220), np.uint8)
    for number in range(3):
        frame = FrameVoxels(seen, violet, np.empty(0, np.int64), 1000.0 + number)
        store.write(frame, "flat", 1)
        store.accept(frame, "flat", 1)
    page = open_page()
    assert wait_for_violet(page, "#canvas")
    page.click("#solid")
    page.wait_for_selector(CANVAS)
    assert wait_for_violet(page, CANVAS)
    page.uncheck("[data-layer=surface]")
    drawn_otherwise(page, None)
    assert not has_violet(page, CANVAS)


def has_violet(page: Any, canvas: str) -> bool:
    """Whether more than a hundred pixels of a canvas are violet."""
    data = np.frombuffer(page.locator(canvas).screenshot(), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR).astype(int)
    blue, green, red = np.moveaxis(picture, -1, 0)
    return int(((red > 150) & (blue > 150) & (green < 90)).sum()) > 100


def wait_for_violet(page: Any, canvas: str) -> bool:
    """Wait until the surface has been read and drawn."""
    for _ in range(100):
        if has_violet(page, canvas):
            return True
        page.wait_for_timeout(200)
    return False
