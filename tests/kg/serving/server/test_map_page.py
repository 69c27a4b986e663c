"""The live map in a real browser."""

from __future__ import annotations

import csv
import io
import itertools
import json
import re
import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from kg.model.records import MapUpdate, RobotRecord
from kg.serving.opening import in_memory_map
from kg.serving.server import MapServer, Settings
from planner.search.plans.report import find_answer
from tests.kg.serving.server.browser_pages import HOSTILE, OpenPage, faults, open_menu, says

if TYPE_CHECKING:
    from conftest import Served

    from kg.maps.semantic_map import SemanticMap

CUP = "object/1"


@pytest.fixture
def served(flat: SemanticMap, serve: Callable[..., Served]) -> Served:
    return serve(planner=partial(find_answer, flat))


@pytest.fixture
def token(served: Served) -> str:
    return served.bearer()["Authorization"].removeprefix("Bearer ")


def test_objects_and_places_are_drawn_and_listed(open_page: OpenPage) -> None:
    page = open_page()
    says(page, "#count", "2 of 2 objects, 1 place")
    page.click("text=All objects")
    says(page, "#objects", "cup 1 in the kitchen, 80 % sure")
    picture = cv2.imdecode(np.frombuffer(page.locator("#canvas").screenshot(), np.uint8), 1)
    colours = len(np.unique(picture.reshape(-1, 3), axis=0))
    assert colours > 20


def test_address_of_an_object_selects_it(open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}")
    says(page, "#about h2", "cup 1")
    says(page, "#about dl", "1.00, 0.50, 0.80 m")
    says(page, "#about-history", "new: cup")


@pytest.mark.parametrize("fragment", ["#%E0%A4%A", "#javascript:alert(1)", "#%22%3E<img src=x>"])
def test_an_address_that_names_nothing_selects_nothing(
    fragment: str, served: Served, open_page: OpenPage
) -> None:
    page = open_page(fragment)
    says(page, "#about", "Nothing is selected")
    served.put(3, "bowl", 2.0, 2.0)
    says(page, "#count", "3 of 3 objects")


def test_an_iri_with_a_percent_sign_is_found_again_by_its_address(
    served: Served, open_page: OpenPage
) -> None:
    odd = "https://x/t%41b"
    served.write(f"INSERT DATA {{ <{odd}> a here:Cup ; rdfs:label 'odd' ; here:x 1 ; here:y 1 }}")
    page = open_page()
    page.click("text=All objects")
    page.click("#objects >> text=odd")
    says(page, "#about h2", "odd")
    page.reload()
    says(page, "#about h2", "odd")


def test_a_robot_that_is_nowhere_near_does_not_stop_the_page(
    served: Served, open_page: OpenPage
) -> None:
    served.map.apply(MapUpdate(robot=RobotRecord(np.array([1e30, 0.0, 0.0]), 0.0, 1.7e9)))
    page = open_page(f"#{CUP}")
    says(page, "#about h2", "cup 1")


def test_a_plan_without_finite_numbers_is_refused_in_words(serve: Callable[..., Served]) -> None:
    accept = {"Accept": "application/json"}
    server = serve(planner=lambda wanted: {"target": wanted[0], "seconds": float("inf")})
    answer = server.get("find", params={"object": "cup"}, headers=accept)
    assert answer.status_code == 422
    assert "finite" in answer.json()["detail"]


def test_changes_arrive_without_reloading(served: Served, open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}")
    served.put(3, "bowl", 2.0, 2.0)
    says(page, "#count", "3 of 3 objects")
    served.map.apply(MapUpdate(removed=(f"{served.map.base}object/3",)))
    says(page, "#count", "2 of 2 objects")


def test_what_is_said_of_the_selected_thing_follows_it(served: Served, open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}")
    says(page, "#about dl", "1.00, 0.50, 0.80 m")
    served.move(1, 3.25)
    says(page, "#about dl", "3.25, 0.50, 0.80 m")
    served.map.apply(MapUpdate(removed=(f"{served.map.base}{CUP}",)))
    says(page, "#about", "Nothing is selected")


def test_the_past_is_shown_as_it_was(served: Served, open_page: OpenPage) -> None:
    first = served.map.sequence
    served.put(3, "bowl", 2.0, 2.0)
    page = open_page()
    says(page, "#count", "3 of 3 objects")
    page.click("#earlier")
    says(page, "#count", "2 of 2 objects")
    says(page, "#moment", ":")  # a time
    assert f"transaction {first} of" in page.locator("#moment").get_attribute("title")
    page.locator("#time").fill("10000")
    says(page, "#count", "3 of 3 objects")
    says(page, "#moment", "now")
    page.locator("#time").fill("0")
    says(page, "#count", "0 of 0 objects")


def test_who_drags_through_time_asks_for_one_state_at_a_time(
    served: Served, open_page: OpenPage
) -> None:
    for n in range(20):
        served.move(1, 1 + n / 10)
    page = open_page()
    says(page, "#moment", "now")
    page.wait_for_selector("#marks text")
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.evaluate("""() => { const time = document.getElementById("time");
        for (let step = 10000; step >= 0; step -= 40) {
          time.value = step;
          time.dispatchEvent(new Event("input")); } }""")
    says(page, "#count", "0 of 0 objects")
    states = [url for url in asked if "/state?at=" in url]
    assert 1 <= len(states) <= 3
    assert len([url for url in asked if "/sparql" in url]) == 0


def test_a_moment_that_cannot_be_shown_leaves_the_label_of_what_is_drawn(
    served: Served, open_page: OpenPage
) -> None:
    page = open_page()
    page.wait_for_selector("#marks text")
    page.route("**/state?at=*", lambda route: route.fulfill(status=404, body="too old"))
    page.locator("#time").fill("0")
    says(page, "#status", "too old")
    says(page, "#moment", "now")
    says(page, "#count", "2 of 2 objects")
    assert page.input_value("#time") == "10000"


def test_two_moments_are_compared(served: Served, open_page: OpenPage) -> None:
    served.put(3, "bowl", 2.0, 2.0)
    served.move(1, 3.0)
    page = open_page()
    page.click("#earlier")
    page.click("#earlier")
    says(page, "#count", "2 of 2 objects")
    page.click("#compare")
    says(page, "#changes", "No thing came")
    page.click("#now")
    says(page, "#changes", "Appeared (1)")
    says(page, "#changes", "cup 1 by 2.00 m")
    page.click("#changes >> text=cup 1")
    says(page, "#about h2", "cup 1")
    page.click("#compare")
    page.wait_for_selector("#changes h3", state="detached")


def test_the_axis_tells_time_and_change_under_the_pointer(
    served: Served, open_page: OpenPage
) -> None:
    for n in range(3):
        served.put(3 + n, "bowl", 2.0, 2.0)
    page = open_page()
    page.wait_for_selector("#marks text")
    axis = page.locator("#time").bounding_box()
    for x in range(0, int(axis["width"]), 4):
        page.mouse.move(axis["x"] + x, axis["y"] + axis["height"] / 2)
        if "1 came or went" in page.inner_text("#pointed"):
            break
    assert re.match(r"\d+:\d\d:\d\d [AP]M, 1 came or went", page.inner_text("#pointed"))
    page.mouse.down()
    page.mouse.move(axis["x"] + 10, axis["y"] + axis["height"] / 2, steps=4)
    says(page, "#moment", ":")
    assert page.locator("#time").bounding_box() == axis  # it stays under the finger
    page.mouse.up()


def test_rooms_are_compared_at_every_door(served: Served, open_page: OpenPage) -> None:
    before = served.map.sequence
    bearer = {
        "json": {
            "kind": "split",
            "places": ["place/1"],
            "points": [[1.5, -1], [1.5, 3]],
            "name": "pantry",
        }
    }
    assert served.post("rooms", headers=served.bearer(), **bearer).ok
    found = {
        (one.kind, one.title, one.before, one.after)
        for one in served.map.history.compare(before).rooms
    }
    assert ("appeared", "pantry", "", "10.0 m²") in found
    assert ("reshaped", "the kitchen", "20.0 m²", "10.0 m²") in found
    told = served.get("diff", params={"from": str(before)}, headers={"Accept": "text/plain"}).text
    assert "reshaped place/1 the kitchen: 20.0 m² -> 10.0 m²" in told
    page = open_page(f"#?from={before}")
    says(page, "#changes", "Appeared: rooms (1)")
    says(page, "#changes", "the kitchen: 20.0 m², now 10.0 m²")
    page.click("#changes >> text=pantry")
    says(page, "#about h2", "pantry")


def test_a_correction_lands_in_the_graph_and_on_other_pages(
    served: Served, open_page: OpenPage, token: str
) -> None:
    page, other = open_page(f"#{CUP}"), open_page()
    other.click("text=All objects")
    page.click("#edit")
    page.fill("#token", token)
    page.click("#corrector button")
    page.fill("[aria-label=name]", "the blue mug")
    page.click("text=rename")
    says(other, "#objects", "the blue mug")
    (made,) = served.map.assertions.all(f"{served.map.base}{CUP}")
    assert (made.property, made.value, made.by) == ("label", "the blue mug", "ann")
    page.click("text=undo")
    says(other, "#objects", "cup 1")
    assert served.map.assertions.all() == ()
    kept = page.evaluate("JSON.stringify([location.href, {...localStorage}, {...sessionStorage}])")
    assert token not in kept


def test_a_wrong_token_is_refused_in_words(served: Served, open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}")
    page.click("#edit")
    page.fill("#token", "not-the-token-at-all")
    page.click("#corrector button")
    says(page, "#status", "this token may not write")
    assert page.locator("text=it is not there").count() == 0
    assert served.map.assertions.all() == ()


def test_names_of_things_are_never_markup(served: Served, open_page: OpenPage) -> None:
    served.map.assertions.add(f"{served.map.base}{CUP}", "label", HOSTILE, by="mallory")
    page = open_page(f"#{CUP}")
    says(page, "#about h2", HOSTILE)
    page.click("text=All objects")
    says(page, "#objects", HOSTILE)
    assert page.locator("main img").count() == 0


def test_find_draws_the_plan_with_its_reasons(open_page: OpenPage) -> None:
    page = open_page()
    page.fill("#wanted", "cup")
    page.click("#find button")
    says(page, "#plan", "cup 1")
    says(page, "#plan ol", "look 1")
    says(page, "#plan ol", "cup 1 is in the map")


def test_of_two_searches_in_a_row_the_last_one_is_answered(
    serve: Callable[..., Served], flat: SemanticMap, open_page: OpenPage
) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slowly(wanted: list[str]) -> Mapping[str, object]:
        if wanted == ["cup"]:
            begun.set()
            assert go_on.wait(60)
        return find_answer(flat, wanted)

    page = open_page(of=serve(planner=slowly))
    page.fill("#wanted", "cup")
    page.click("#find button")
    assert begun.wait(60)
    page.fill("#wanted", "chair")
    page.click("#find button")
    says(page, "#plan", "planning")
    go_on.set()
    says(page, "#plan", "chair 2")
    assert "cup 1 is in the map" not in page.inner_text("#plan")


def test_the_page_of_a_thing_leads_to_where_it_stands(open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}")
    page.click("text=Open its page")
    page.click("text=show it on the map")
    says(page, "#about h2", "cup 1")


def test_an_object_is_picked_on_the_canvas_and_keys_move_it(open_page: OpenPage) -> None:
    page = open_page("#?view=1.00,0.50,150.00")  # the cup in the middle
    box = page.locator("#canvas").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    says(page, "#about h2", "cup 1")
    page.focus("#canvas")
    page.keyboard.press("0")
    page.keyboard.press("+")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_has_no_fault_of_accessibility(scheme: str, open_page: OpenPage) -> None:
    pytest.importorskip("axe_playwright_python")
    page = open_page(f"#{CUP}", color_scheme=scheme, bypass_csp=True)
    says(page, "#about-history", "new: cup")
    for step in ("#earlier", "#compare"):
        page.wait_for_selector(f"{step}:enabled")
        page.click(step)
    says(page, "#changes", "From")
    assert faults(page) == []


def test_a_phone_shows_the_map_first_and_keeps_it(open_page: OpenPage) -> None:
    page = open_page()
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.locator("#canvas").bounding_box()["width"] > 300
    top, field = (page.locator(one).bounding_box()["y"] for one in ("#canvas", "#wanted"))
    assert top < 20 < field < 844
    page.click("text=All objects")
    page.evaluate("document.querySelector('#objects li:last-child').scrollIntoView()")
    assert page.locator("#canvas").bounding_box()["y"] >= 0
    compare = page.locator("#compare").bounding_box()
    assert compare["x"] + compare["width"] <= 390


def test_rooms_are_edited_by_mouse_and_keyboard(
    open_page: OpenPage, flat: SemanticMap, token: str
) -> None:
    page = open_page("#place/1")
    page.click("#edit")
    page.fill("#token", token)
    page.click("#corrector button")
    (place,) = flat.places()
    x, y = place.area.centre

    def click(*points: tuple[float, float]) -> None:
        page.focus("#canvas")
        page.keyboard.press("0")  # shows the whole map in the middle, with margins of 56 and 30 px
        box = page.locator("#canvas").bounding_box()
        width, height = place.area.size
        scale = min(
            (box["width"] - 112) / (width + 0.4), (box["height"] - 60) / (height + 0.4), 250
        )
        for u, v in points:
            right, up = (u - x) * scale, (v - y) * scale
            page.mouse.click(box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 - up)

    def areas() -> dict[str, float]:
        return {one.label: round(one.area.area, 1) for one in flat.places()}

    whole = areas()
    page.fill("[aria-label='name of a new place']", "pantry")
    page.click("text=split")
    says(page, "#status", "click two points")
    click((x, place.ymin + 0.2), (x, place.ymax - 0.2))
    says(page, "#status", "rooms: split")
    assert areas().keys() == {*whole, "pantry"}
    says(page, "#count", "2 places")
    page.click("text=merge with")
    pantry = next(one for one in flat.places() if one.label == "pantry")
    click(pantry.area.centre)
    says(page, "#status", "rooms: merge")
    assert areas() == pytest.approx(whole)
    says(page, "#count", "1 place")
    page.click("text=draw a place")
    click((x, y), (x + 0.5, y), (x + 0.5, y + 0.5))
    page.keyboard.press("Enter")
    says(page, "#status", "rooms: draw")
    assert len(areas()) == 2
    page.click("text=undo my last edit")
    says(page, "#status", "rooms: undo")
    assert areas() == pytest.approx(whole)
    page.click("text=split")
    page.keyboard.press("Escape")
    says(page, "#status", "nothing was changed")


def test_a_shared_address_brings_everything_back(served: Served, open_page: OpenPage) -> None:
    first = served.map.sequence
    served.put(3, "bowl", 2.0, 2.0)
    page = open_page(f"#{CUP}")
    says(page, "#about h2", "cup 1")
    page.wait_for_selector("#earlier:enabled")
    page.click("#compare")
    page.click("#earlier")
    says(page, "#count", "2 of 2 objects")
    open_menu(page, "layers")
    page.uncheck("[data-layer=labels]")
    page.check("[data-layer=viewed]")
    page.focus("#canvas")
    page.keyboard.press("+")
    page.fill("#filter", "cup")
    page.wait_for_url(re.compile(r"view=.*filter=cup"))
    address = page.evaluate("location.pathname + location.hash")
    other = open_page(address.removeprefix("/"))
    says(other, "#about h2", "cup 1")
    says(other, "#count", "1 of 2 objects")
    says(other, "#changes", "Gone (1)")
    assert f"transaction {first} of" in other.locator("#moment").get_attribute("title")
    assert not other.is_checked("[data-layer=labels]")
    assert other.is_checked("[data-layer=viewed]")
    other.wait_for_url(re.compile(r"view=.*filter=cup"))
    assert other.evaluate("location.hash") == page.evaluate("location.hash")


def test_a_shared_search_is_made_again(open_page: OpenPage) -> None:
    page = open_page()
    page.fill("#wanted", "cup")
    page.click("#find button")
    says(page, "#plan ol", "look 1")
    says(page, "#about h2", "cup 1")  # what is found is selected
    page.wait_for_url(re.compile("find=cup"))
    page.reload()
    says(page, "#plan ol", "look 1")
    assert page.input_value("#wanted") == "cup"


def test_a_search_that_fails_leaves_no_old_plan(open_page: OpenPage) -> None:
    page = open_page()
    page.fill("#wanted", "cup")
    page.click("#find button")
    says(page, "#plan ol", "look 1")
    page.fill("#wanted", "no such thing at all")
    page.click("#find button")
    page.wait_for_selector("#plan ol", state="detached")
    says(page, "#plan", "no such thing")


def test_an_empty_map_says_what_to_do(open_page: OpenPage) -> None:
    with in_memory_map() as nothing, MapServer(nothing, Settings(port=0)) as server:
        page = open_page(of=server)
        says(page, "#empty", "hereabouts map")
        assert page.is_visible("#empty")
        page.close()


@pytest.mark.parametrize("kind", ["PNG", "CSV", "GeoJSON"])
def test_what_is_shown_is_saved(kind: str, open_page: OpenPage) -> None:
    page = open_page("#?filter=cup")
    says(page, "#count", "1 of 2 objects")
    open_menu(page, "more")
    with page.expect_download() as saved:
        page.click(f"#exports >> text={kind}")
    data = saved.value.path().read_bytes()
    if kind == "PNG":
        assert data.startswith(b"\x89PNG")
    elif kind == "CSV":
        (row,) = csv.DictReader(io.StringIO(data.decode()))
        assert (row["name"], float(row["x"]), row["place"]) == ("cup 1", 1.0, "the kitchen")
    else:
        cup, kitchen = json.loads(data)["features"]
        assert cup["geometry"] == {"type": "Point", "coordinates": [1, 0.5]}
        assert len(kitchen["geometry"]["coordinates"][0]) == 5


def test_the_page_of_an_object_has_its_place_reasons_and_history(open_page: OpenPage) -> None:
    page = open_page("object/1")
    says(page, "h1", "cup 1")
    says(page, "#about-why", "cup 1 is a cup")
    says(page, "#about-history", "new: cup")
    says(page, "#about dl", "in the kitchen")
    page.click(".source summary >> nth=0")
    says(page, ".source[open]", "is a cup")
    assert page.locator("#canvas").bounding_box()["height"] > 200
    assert not page.is_visible("table.facts >> nth=0")
    page.click("summary:has-text('Facts') >> nth=0")
    assert page.is_visible("table.facts >> nth=0")


def test_times_of_the_last_view_differ_for_all_kinds_of_colour_vision(open_page: OpenPage) -> None:
    page = open_page()
    schemes = page.evaluate("import('/files/surface.js').then((module) => module.VIEWED)")
    # Machado, Oliveira and Fernandes 2009: complete protanopia, deuteranopia and tritanopia
    seen_by = {
        "all": np.eye(3),
        "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
        "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
        "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
    }
    for colours in schemes.values():
        linear = {name: (np.array(rgb) / 255) ** 2.2 for name, rgb in colours.items()}
        for kind, matrix in ((kind, np.array(rows)) for kind, rows in seen_by.items()):
            seen = {
                n: np.clip(np.array(matrix) @ rgb, 0, 1) ** (1 / 2.2) for n, rgb in linear.items()
            }
            for one, other in itertools.combinations(seen, 2):
                assert np.linalg.norm(seen[one] - seen[other]) > 0.15, (kind, one, other)
