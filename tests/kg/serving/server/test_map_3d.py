"""What the live map draws: three dimensions, surface, pictures, things without a name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import ObjectPictures
from kg.maps.surface.voxels import FrameVoxels, keys_of
from kg.model import vocabulary as v
from kg.model.records import (
    FREE,
    SURFACE,
    TALL,
    Evidence,
    FloorTile,
    MapUpdate,
    PlaceRecord,
    RobotRecord,
)
from kg.serving.opening import create_map
from tests.kg.serving.server.browser_pages import (
    HOSTILE,
    OpenPage,
    click_map,
    go_to,
    has_violet,
    open_menu,
    other_picture,
    picture,
    picture_where,
    same_picture,
    says,
    show_layer,
    unlock,
)
from tests.kg.serving.server.conftest import BASE, TOKEN, answering, furnished, thing

if TYPE_CHECKING:
    from conftest import Served
    from numpy.typing import NDArray

    from kg.maps.semantic_map import SemanticMap
    from kg.model.records import ObjectRecord


THING = "object/7"
VIOLET = (200, 20, 220)
SEEN = Evidence("frame-1", "flat", 1.7e9, (1.0, 2.0, 3.0, 4.0), 0.9, "a detector")


def has_grey(image: Any) -> bool:
    """Whether more than ten thousand pixels of a picture have the grey of the made floor."""
    return int((np.abs(image.astype(int) - 120).max(axis=-1) < 12).sum()) > 10_000


def lay_floor(semantic_map: SemanticMap) -> None:
    """A floor with a wall, and a robot."""
    cells = np.full((32, 32), FREE, np.uint8)
    cells[0] = TALL
    tile = FloorTile(0, 0, 0, -1.3, 0.1, cells, 0.0)
    robot = RobotRecord(np.array([1.0, 1.0, 1.2]), 0.5, 10.0)
    semantic_map.apply(MapUpdate(floor=(tile,), robot=robot))


@pytest.fixture(scope="module")
def shown() -> Iterator[Served]:
    with furnished() as semantic_map, answering(semantic_map) as served:
        lay_floor(semantic_map)
        yield served


def solid(page: Any) -> Any:
    """The picture of the page's map in three dimensions, to which it is turned."""
    flat = picture(page)
    page.click("#solid")
    page.mouse.move(1, 1)
    return other_picture(page, flat)


def test_a_click_on_a_box_or_a_floor_selects_what_it_is(open_page: OpenPage) -> None:
    page = open_page()
    solid(page)
    for address, name in (("object/1", "cup 1"), ("place/1", "kitchen")):
        go_to(page, address)
        says(page, "#about h2", name)
        go_to(page, "")
        says(page, "#about", "Ask a question")
        click_map(page)
        says(page, "#about h2", name)


def test_it_is_turned_by_mouse_and_keys_and_comes_back(open_page: OpenPage) -> None:
    page = open_page()
    flat = picture(page)
    first = solid(page)
    assert page.get_attribute("#solid", "aria-pressed") == "true"
    box = page.locator("#canvas").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 320, box["y"] + 240)
    page.mouse.up()
    page.mouse.move(1, 1)
    turned = other_picture(page, first)
    says(page, "#about", "Ask a question")
    page.focus("#canvas")
    page.keyboard.press("ArrowLeft")
    moved = other_picture(page, turned)
    page.keyboard.press("+")
    other_picture(page, moved)
    page.keyboard.press("0")
    same_picture(page, first)
    page.click("#solid")
    page.mouse.move(1, 1)
    same_picture(page, flat)
    assert page.get_attribute("#solid", "aria-pressed") == "false"


def test_changes_filters_plans_and_the_past_are_drawn(own: Served, open_page: OpenPage) -> None:
    lay_floor(own.map)
    page = open_page("", own)
    first = solid(page)
    own.map.assertions.add(f"{own.map.base}object/1", "label", HOSTILE, by="ann")
    named = other_picture(page, first)
    own.put(3, "bowl", 2.0, 2.0)
    more = other_picture(page, named)
    open_menu(page, "layers")
    page.fill("#filter", "chair")
    fewer = other_picture(page, more)
    page.fill("#filter", "")
    all_again = other_picture(page, fewer)
    page.fill("#wanted", "chair")
    page.press("#wanted", "Enter")
    page.wait_for_selector("#plan ol li", state="attached")
    planned = other_picture(page, all_again)
    page.locator("#time").fill("1")
    other_picture(page, planned)


def test_a_busy_machine_draws_the_map_at_rest_with_double_resolution(open_page: OpenPage) -> None:
    late = """window.requestAnimationFrame = (draw) => setTimeout(draw, 400);
        window.cancelAnimationFrame = clearTimeout;"""
    page = open_page(script=late)
    for _ in range(2):
        page.wait_for_selector("#canvas[data-drawn=smoothly]")
        page.wait_for_timeout(700)
        wide, shown = page.evaluate("[canvas.width, canvas.clientWidth]")
        assert wide == 2 * shown
        page.click("#closer")


def test_without_webgl_the_map_has_outlines_and_says_so(open_page: OpenPage) -> None:
    page = open_page(
        script="""
        const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            return kind === "webgl2" ? null : get.call(this, kind, ...more); };"""
    )
    says(page, "#map", "This browser draws no WebGL 2")
    says(page, "#count", "2 of 2 objects, 1 place")
    first = picture(page)
    click_map(page)
    says(page, "#about h2", "kitchen")
    other_picture(page, first)


def test_graphics_that_are_lost_come_back(open_page: OpenPage) -> None:
    page = open_page()
    whole = solid(page)
    page.evaluate(
        """() => { const context = document.querySelector("#canvas").getContext("webgl2");
        window.memory = context.getExtension("WEBGL_lose_context");
        window.memory.loseContext(); }"""
    )
    says(page, "#map", "released its graphics memory")
    other_picture(page, whole)
    page.evaluate("() => window.memory.restoreContext()")
    same_picture(page, whole)


def add_surface(served: Served, *parts: tuple[NDArray[np.int64], tuple[int, int, int]]) -> None:
    """Voxels of 2.5 cm, each part (3, n) of them in a colour."""
    store = served.map.surface_store
    assert store is not None
    store.begin(0.025)
    keys = np.concatenate([keys_of(voxels) for voxels, _ in parts])
    colours = np.concatenate([np.full((voxels.shape[1], 3), rgb) for voxels, rgb in parts])
    order = np.argsort(keys)
    for number in range(3):
        frame = FrameVoxels(
            keys[order], colours[order].astype(np.uint8), np.empty(0, np.int64), 1000.0 + number
        )
        store.write(frame, "flat", 1)
        store.accept(frame, "flat", 1)


def box_of(x: tuple[int, int], y: tuple[int, int], z: tuple[int, int]) -> NDArray[np.int64]:
    """(3, n) voxels between corners."""
    return np.mgrid[slice(*x), slice(*y), slice(*z)].reshape(3, -1)


def add_plate(served: Served, height: float) -> None:
    """A violet surface from (0.5, 0.5) to (1.75, 1.75) m at a height [m]."""
    level = round(height / 0.025)
    add_surface(served, (box_of((20, 70), (20, 70), (level, level + 1)), VIOLET))


@pytest.mark.parametrize(
    ("turned", "fades"), [("0.00", True), ("3.14", False)], ids=["its back", "its front"]
)
def test_an_outer_wall_fades_where_it_hides_the_room(
    own: Served, open_page: OpenPage, turned: str, fades: bool
) -> None:
    lay_floor(own.map)
    floor, wall = box_of((0, 120), (0, 120), (-52, -51)), box_of((0, 120), (0, 3), (-40, 20))
    add_surface(own, (floor, (120, 120, 120)), (wall, VIOLET))  # above the low part that stays
    page = open_page(f"#?solid=1&view=1.50,1.50,90.00,{turned},1.00,-0.90", own)
    picture_where(page, lambda now: has_violet(now) != fades and has_grey(now))


def test_a_wall_between_two_rooms_stays(own: Served, open_page: OpenPage) -> None:
    lay_floor(own.map)
    floor, wall = box_of((0, 120), (0, 120), (-52, -51)), box_of((0, 120), (60, 63), (-52, 20))
    add_surface(own, (floor, (120, 120, 120)), (wall, VIOLET))
    page = open_page("#?solid=1&view=1.50,1.50,90.00,0.00,1.00,-0.90", own)
    picture_where(page, has_violet)


def test_the_surface_is_drawn_up_to_the_cut_and_measured(own: Served, open_page: OpenPage) -> None:
    lay_floor(own.map)
    add_plate(own, -0.3)  # a metre above the floor
    page = open_page("", own)
    picture_where(page, has_violet)
    open_menu(page, "layers")
    page.locator("#cut").fill("0.5")
    page.wait_for_url("**cut=0.5*")
    page.keyboard.press("Escape")
    picture_where(page, lambda now: not has_violet(now))
    go_to(page, "?solid=1&view=1.10,1.10,150.00,0.00,0.30,-0.30")
    picture_where(page, has_violet)
    page.click("#measure")
    page.focus("#canvas")
    page.keyboard.press(" ")  # the middle of the view: on the plate
    says(page, "#status", "second point")
    box = page.locator("#canvas").bounding_box()
    page.mouse.click(box["x"] + 40, box["y"] + box["height"] - 40)  # the floor
    says(page, "#status", "1.01 m of it in height")
    page.keyboard.press("Escape")
    assert page.get_attribute("#measure", "aria-pressed") == "false"
    show_layer(page, "surface", False)
    picture_where(page, lambda now: not has_violet(now))
    go_to(page, "?cut=0.5")
    says(page, "#cut-shown", "0.5")


def test_many_objects_are_circles_that_lead_nearer(own: Served, open_page: OpenPage) -> None:
    place = PlaceRecord(f"{own.map.base}place/1", "the hall", -100, 100, -100, 100, views=3)
    many = [thing(own.map, 10 + n, "cup", n % 20 / 5, n // 20 / 5) for n in range(500)]
    own.map.apply(MapUpdate(objects=tuple(many), places=(place,)))
    page = open_page("", own)
    says(page, "#count", "502 of 502 objects")
    first = picture(page)
    scale = (page.locator("#canvas").bounding_box()["height"] - 60) / 200.4
    click_map(page, 2 * scale, 2.5 * scale)
    page.wait_for_url("**view=*")
    other_picture(page, first)
    says(page, "#about", "Ask a question")
    near = float(page.url.split("view=")[1].split("%2C")[2].split("&")[0])
    assert near == pytest.approx(4 * scale, rel=0.1)


def unnamed(semantic_map: SemanticMap) -> ObjectRecord:
    """A thing without a name in the middle of the kitchen."""
    return replace(
        thing(semantic_map, 7, "cup", 1.5, 1.0),
        category=v.UNNAMED_THING,
        extent=np.array([0.6, 0.3, 0.2]),
        yaw=0.4,
        evidence=replace(SEEN, model=SURFACE),
    )


def test_a_thing_without_a_name_is_an_outline_that_a_click_selects(own, open_page):
    own.map.apply(MapUpdate(objects=(unnamed(own.map),)))
    page = open_page("", own)
    says(page, "#count", "2 of 2 objects")  # not in the list
    page.click("text=All objects")
    assert "unnamed" not in page.locator("#objects").inner_text()
    for is_flat in (True, False):
        if not is_flat:
            page.click("#solid")
            go_to(page, "")
            says(page, "#about", "Ask a question")
            go_to(page, THING)  # which flies there
            says(page, "#about h2", "unnamed thing")
            go_to(page, "")
        says(page, "#about", "Ask a question")
        page.mouse.move(1, 1)
        outlined = picture(page)
        show_layer(page, "things", False)
        other_picture(page, outlined)
        show_layer(page, "things", True)
        same_picture(page, outlined)
        click_map(page)
        says(page, "#about h2", "unnamed thing")
        says(page, "#about dl", "20 cm high")


def test_a_name_given_on_the_page_makes_it_an_object(own: Served, open_page: OpenPage) -> None:
    own.map.apply(MapUpdate(objects=(unnamed(own.map),)))
    page, other = open_page(f"#{THING}", own), open_page("", own)
    unlock(page, TOKEN)
    page.fill("[aria-label=category]", "bottle")
    page.click("text=is a")
    for one in (page, other):
        says(one, "#count", "3 of 3 objects")
    says(page, "#about dl", "bottle")
    page.click("text=undo")
    says(other, "#count", "2 of 2 objects")
    go_to(other, THING)
    says(other, "#about h2", "unnamed thing")


def test_the_past_has_the_things_of_that_time(own: Served) -> None:
    own.map.apply(MapUpdate(objects=(unnamed(own.map),)))
    now = own.get("state").json()
    assert [one["iri"] for one in now["things"]] == [THING]
    assert now["things"][0]["dx"] == 0.6 and "class" not in now["things"][0]
    past = own.get("state", params={"at": own.map.sequence - 1}).json()
    assert past["things"] == [] and past["objects"] == now["objects"]
    assert "things" not in own.get("state", params={"objects": "0"}).json()


def test_the_selected_thing_and_near_ones_have_their_picture(tmp_path, on_disk, open_page):
    folder = tmp_path / "flat.map"
    violet = cv2.imencode(".jpg", np.full((40, 60, 3), (220, 20, 200), np.uint8))[1].tobytes()
    with create_map(folder, base=BASE) as semantic_map:
        cup = replace(thing(semantic_map, 1, "cup", 1.0, 0.5), evidence=SEEN)
        semantic_map.apply(MapUpdate(objects=(cup, unnamed(semantic_map))))
        for record in (cup, unnamed(semantic_map)):
            ObjectPictures(folder).write(record, violet)
    with on_disk(folder) as other:
        page = open_page("#?view=1.00,0.50,250.00", other)
        picture_where(page, has_violet)
        show_layer(page, "pictures", False)
        picture_where(page, lambda now: not has_violet(now))
        go_to(page, "object/1")
        picture_where(page, has_violet)
        go_to(page, THING)
        page.wait_for_selector("#about [aria-label='unnamed thing 7 as it was seen best']")
        page.close()
