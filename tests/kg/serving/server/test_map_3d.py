"""The live map in three dimensions, in a real browser that draws in software."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import ObjectPictures
from kg.maps.surface.voxels import FrameVoxels, keys_of
from kg.model.records import FREE, TALL, Evidence, FloorTile, MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import create_map
from planner.search.plans.report import find_answer
from tests.kg.serving.server.browser_pages import (
    HOSTILE,
    OpenPage,
    faults,
    open_menu,
    says,
    show_layer,
)
from tests.kg.serving.server.conftest import BASE, thing

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Served

    from kg.maps.semantic_map import SemanticMap

CANVAS = "#canvas"


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
    drawn_otherwise(page, None)
    return page


def drawn_otherwise(page: Any, before: bytes | None) -> bytes:
    """The picture of the map as soon as it is another one than `before`, and rests."""
    last = before
    while True:
        page.wait_for_timeout(200)
        page.wait_for_selector(f"{CANVAS}[data-drawn=smoothly]")
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
    open_menu(solid, "layers")
    first = drawn_otherwise(solid, None)
    served.put(3, "bowl", 2.0, 2.0)
    more = drawn_otherwise(solid, first)
    solid.fill("#filter", "cup")
    fewer = drawn_otherwise(solid, more)
    solid.fill("#filter", "")
    drawn_otherwise(solid, fewer)
    solid.fill("#wanted", "cup")
    solid.press("#wanted", "Enter")
    solid.wait_for_selector("#plan ol li", state="attached")
    planned = drawn_otherwise(solid, fewer)
    solid.locator("#time").fill("1")
    drawn_otherwise(solid, planned)


def test_names_of_anybody_are_text(served: Served, solid: Any) -> None:
    before = drawn_otherwise(solid, None)
    served.map.assertions.add(f"{served.map.base}object/1", "label", HOSTILE, by="ann")
    drawn_otherwise(solid, before)


def test_the_flat_map_comes_back(open_page: OpenPage) -> None:
    page = open_page()
    flat = drawn_otherwise(page, None)
    page.click("#solid")
    solid = drawn_otherwise(page, flat)
    assert page.get_attribute("#solid", "aria-pressed") == "true"
    page.click("#solid")
    page.mouse.move(1, 1)
    assert drawn_otherwise(page, solid) == flat
    assert page.get_attribute("#solid", "aria-pressed") == "false"


def test_without_webgl_the_map_has_outlines_and_says_so(open_page: OpenPage, browser: Any) -> None:
    page = open_page(
        script="""
        const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            return kind === "webgl2" ? null : get.call(this, kind, ...more); };"""
    )
    says(page, "#map", "This browser draws no WebGL 2")
    says(page, "#count", "2 of 2 objects, 1 place")
    first = drawn_otherwise(page, None)
    box = page.locator(CANVAS).bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    says(page, "#about h2", "kitchen")
    drawn_otherwise(page, first)


def test_graphics_that_are_lost_come_back(solid: Any) -> None:
    whole = drawn_otherwise(solid, None)
    solid.evaluate(
        """selector => { const context = document.querySelector(selector).getContext("webgl2");
        window.memory = context.getExtension("WEBGL_lose_context");
        window.memory.loseContext(); }""",
        CANVAS,
    )
    says(solid, "#map", "released its graphics memory")
    without = drawn_otherwise(solid, whole)
    solid.evaluate("() => window.memory.restoreContext()")
    assert drawn_otherwise(solid, without) == whole


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_has_no_serious_fault(open_page: OpenPage, scheme: str) -> None:
    pytest.importorskip("axe_playwright_python")
    page = open_page(color_scheme=scheme, bypass_csp=True)
    page.click("#solid")
    assert faults(page) == []


def add_plate(served: Served, height: float) -> None:
    """A violet surface from (0.5, 0.5) to (1.75, 1.75) m at a height [m]."""
    store = served.map.surface_store
    assert store is not None
    store.begin(0.025)
    x, y = (axis.ravel() for axis in np.mgrid[20:70, 20:70])
    seen = np.sort(keys_of(np.stack([x, y, np.full_like(x, round(height / 0.025))])))
    violet = np.full((len(seen), 3), (200, 20, 220), np.uint8)
    for number in range(3):
        frame = FrameVoxels(seen, violet, np.empty(0, np.int64), 1000.0 + number)
        store.write(frame, "flat", 1)
        store.accept(frame, "flat", 1)


def test_what_is_higher_than_the_cut_is_not_drawn(served: Served, open_page: OpenPage) -> None:
    add_plate(served, -0.3)  # a metre above the floor
    page = open_page()
    assert wait_for_violet(page, CANVAS)
    open_menu(page, "layers")
    page.locator("#cut").fill("0.5")
    drawn_otherwise(page, None)
    assert not has_violet(page, CANVAS)
    page.wait_for_url("**cut=0.5*")
    other = open_page(page.url.removeprefix(served.url))
    says(other, "#cut-shown", "0.5")


def test_heights_are_measured_in_three_dimensions(served: Served, open_page: OpenPage) -> None:
    add_plate(served, -0.3)  # a metre above the floor
    page = open_page("#?solid=1&view=1.10,1.10,150.00,0.00,0.30,-0.30")
    assert wait_for_violet(page, CANVAS)
    page.click("#measure")
    page.focus(CANVAS)
    page.keyboard.press(" ")  # the middle of the view: on the plate
    says(page, "#status", "second point")
    box = page.locator(CANVAS).bounding_box()
    page.mouse.click(box["x"] + 40, box["y"] + box["height"] - 40)  # the floor
    says(page, "#status", "1.01 m of it in height")
    page.keyboard.press("Escape")
    assert page.get_attribute("#measure", "aria-pressed") == "false"


def test_many_objects_are_circles_that_lead_nearer(served: Served, open_page: OpenPage) -> None:
    place = PlaceRecord(f"{served.map.base}place/1", "the hall", -100, 100, -100, 100, views=3)
    many = [thing(served.map, 10 + n, "cup", n % 20 / 5, n // 20 / 5) for n in range(500)]
    served.map.apply(MapUpdate(objects=tuple(many), places=(place,)))
    page = open_page()
    says(page, "#count", "502 of 502 objects")
    first = drawn_otherwise(page, None)
    box = page.locator(CANVAS).bounding_box()
    scale = (box["height"] - 60) / 200.4
    u, v = box["x"] + box["width"] / 2 + 2 * scale, box["y"] + box["height"] / 2 - 2.5 * scale
    page.mouse.click(u, v)
    page.wait_for_url("**view=*")
    drawn_otherwise(page, first)
    says(page, "#about", "Nothing is selected")
    near = float(page.url.split("view=")[1].split("%2C")[2].split("&")[0])
    assert near == pytest.approx(4 * scale, rel=0.1)


def test_the_surface_is_drawn_from_above_and_in_three_dimensions(
    served: Served, open_page: OpenPage
) -> None:
    add_plate(served, -0.5)
    page = open_page()
    assert wait_for_violet(page, "#canvas")
    page.click("#solid")
    assert wait_for_violet(page, CANVAS)
    show_layer(page, "surface", False)
    drawn_otherwise(page, None)
    assert not has_violet(page, CANVAS)


@pytest.mark.parametrize("address", ["#object/1", "#?view=1.00,0.50,250.00"])
def test_the_selected_object_and_near_ones_have_their_picture(
    address: str, tmp_path: Path, on_disk: Callable[..., Any], open_page: OpenPage
) -> None:
    folder = tmp_path / "flat.map"
    with create_map(folder, base=BASE) as semantic_map:
        seen = Evidence("frame-1", "flat", 1.7e9, (1.0, 2.0, 3.0, 4.0), 0.9, "a detector")
        cup = replace(thing(semantic_map, 1, "cup", 1.0, 0.5), evidence=seen)
        semantic_map.apply(MapUpdate(objects=(cup,)))
        violet = np.full((40, 60, 3), (220, 20, 200), np.uint8)
        ObjectPictures(folder).write(cup, cv2.imencode(".jpg", violet)[1].tobytes())
    with on_disk(folder) as other:
        page = open_page(address, of=other)
        assert wait_for_violet(page, CANVAS)
        show_layer(page, "pictures", False)
        drawn_otherwise(page, None)
        assert has_violet(page, CANVAS) == (address == "#object/1")
        page.close()


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
