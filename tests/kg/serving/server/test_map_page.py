"""The live map in a real browser."""

from __future__ import annotations

import itertools
import json
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kg.model.records import MapUpdate, RobotRecord
from kg.serving.opening import in_memory_map
from kg.serving.server import MapServer
from planner.search.plans.find import plan_words
from tests.kg.serving.server.browser_pages import (
    HOSTILE,
    OpenPage,
    faults,
    go_to,
    open_menu,
    picture,
    says,
)
from tests.kg.serving.server.conftest import answering, furnished
from tests.small_server import SMALL

if TYPE_CHECKING:
    from conftest import Served


CUP = "object/1"


@pytest.fixture(scope="module")
def eventful() -> Iterator[Served]:
    """A flat into which a bowl came, and in which the cup was moved then."""
    with furnished() as semantic_map, answering(semantic_map) as served:
        served.put(3, "bowl", 2.0, 2.0)
        served.move(1, 3.0)
        yield served


def test_objects_are_drawn_and_listed_and_their_addresses_select_them(open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}")
    says(page, "#count", "2 of 2 objects, 1 place")
    says(page, "#about h2", "cup 1")
    says(page, "#about dl", "1.00, 0.50, 0.80 m")
    says(page, "#about-history", "appeared")
    page.click("text=All objects")
    says(page, "#objects", "cup 1 in the kitchen, 80 % sure")
    assert len(np.unique(picture(page).reshape(-1, 3), axis=0)) > 20


def test_an_address_that_names_nothing_selects_nothing(open_page: OpenPage) -> None:
    page = open_page("#%E0%A4%A")
    for fragment in ("%E0%A4%A", "javascript:alert(1)", "%22%3E<img src=x>"):
        go_to(page, fragment)
        says(page, "#about", "Ask a question")
        go_to(page, CUP)  # the page lives
        says(page, "#about h2", "cup 1")


def test_changes_arrive_without_reloading(own: Served, open_page: OpenPage) -> None:
    odd = "https://x/t%41b"
    own.write(f"INSERT DATA {{ <{odd}> a here:Cup ; rdfs:label 'odd' ; here:x 1 ; here:y 1 }}")
    # a robot that is nowhere near does not stop the page
    own.map.apply(MapUpdate(robot=RobotRecord(np.array([1e6, 0.0, 0.0]), 0.0, 1.7e9)))
    page = open_page(f"#{CUP}", own)
    says(page, "#about dl", "1.00, 0.50, 0.80 m")
    own.put(4, "bowl", 2.0, 2.0)
    says(page, "#count", "4 of 4 objects")
    own.map.apply(MapUpdate(removed=(f"{own.map.base}object/4",)))
    says(page, "#count", "3 of 3 objects")
    own.move(1, 3.25)
    says(page, "#about dl", "3.25, 0.50, 0.80 m")
    own.map.apply(MapUpdate(removed=(f"{own.map.base}{CUP}",)))
    says(page, "#about", "Ask a question")
    page.click("text=All objects")
    page.click("#objects >> text=odd")  # whose IRI has a percent sign
    says(page, "#about h2", "odd")
    page.reload()
    says(page, "#about h2", "odd")


def test_a_plan_without_finite_numbers_is_refused_in_words(serve: Callable[..., Served]) -> None:
    accept = {"Accept": "application/json"}
    server = serve(planner=lambda wanted: {"target": wanted[0], "seconds": float("inf")})
    answer = server.get("find", params={"object": "cup"}, headers=accept)
    assert answer.status_code == 422
    assert "finite" in answer.json()["detail"]


def test_the_past_is_shown_and_compared(eventful: Served, open_page: OpenPage) -> None:
    page = open_page(of=eventful)
    says(page, "#count", "3 of 3 objects")
    page.click("#earlier")
    page.click("#earlier")
    says(page, "#count", "2 of 2 objects")
    says(page, "#moment", ":")  # a time
    assert "transaction 1 of 3" in page.locator("#moment").get_attribute("title")
    page.click("#compare")
    says(page, "#changes", "No thing came")
    page.click("#now")
    says(page, "#changes", "Appeared (1)")
    says(page, "#changes", "cup 1 by 2.00 m")
    page.click("#changes >> text=cup 1")
    says(page, "#about h2", "cup 1")
    page.click("#compare")
    page.wait_for_selector("#changes h3", state="detached")
    page.locator("#time").fill("0")
    says(page, "#count", "0 of 0 objects")
    page.locator("#time").fill("10000")
    says(page, "#count", "3 of 3 objects")
    says(page, "#moment", "now")


def test_who_drags_through_time_asks_for_one_state_at_a_time(eventful, open_page):
    page = open_page(of=eventful)
    page.wait_for_selector("#marks text")
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.evaluate("""() => { const time = document.getElementById("time");
        for (let step = 10000; step >= 0; step -= 40) {
          time.value = step;
          time.dispatchEvent(new Event("input")); } }""")
    says(page, "#count", "0 of 0 objects")
    assert 1 <= len([url for url in asked if "/state?at=" in url]) <= 3
    assert len([url for url in asked if "/sparql" in url]) == 0
    page.click("#now")
    says(page, "#count", "3 of 3 objects")
    # a moment that cannot be shown leaves the label of what is drawn
    page.route("**/state?at=*", lambda route: route.fulfill(status=404, body="too old"))
    page.locator("#time").fill("0")
    says(page, "#status", "too old")
    says(page, "#moment", "now")
    says(page, "#count", "3 of 3 objects")
    assert page.input_value("#time") == "10000"


def test_the_axis_tells_time_and_change_under_the_pointer(eventful, open_page):
    page = open_page(of=eventful)
    page.wait_for_selector("#marks text")
    axis = page.locator("#time").bounding_box()
    for x in range(0, int(axis["width"]), 4):
        page.mouse.move(axis["x"] + x, axis["y"] + axis["height"] / 2)
        if "1 came or went" in page.inner_text("#pointed"):
            break
    assert re.match(r"\d+:\d\d:\d\d, 1 came or went", page.inner_text("#pointed"))
    page.mouse.down()
    page.mouse.move(axis["x"] + 10, axis["y"] + axis["height"] / 2, steps=4)
    says(page, "#moment", ":")
    assert page.locator("#time").bounding_box() == axis  # it stays under the finger
    page.mouse.up()


def test_rooms_are_compared_at_every_door(own: Served, open_page: OpenPage) -> None:
    before = own.map.sequence
    line = [[1.5, -1], [1.5, 3]]
    split = {"kind": "split", "places": ["place/1"], "points": line, "name": "pantry"}
    assert own.post("rooms", headers=own.bearer(), json=split).ok
    found = {
        (one.kind, one.title, one.before, one.after)
        for one in own.map.history.compare(before).rooms
    }
    assert ("appeared", "pantry", "", "10.0 m²") in found
    assert ("reshaped", "the kitchen", "20.0 m²", "10.0 m²") in found
    told = own.get("diff", params={"from": str(before)}, headers={"Accept": "text/plain"}).text
    assert "reshaped the kitchen: 20.0 m² -> 10.0 m²" in told
    page = open_page(f"#?from={before}", own)
    says(page, "#changes", "Appeared: rooms (1)")
    says(page, "#changes", "the kitchen: 20.0 m², now 10.0 m²")
    page.click("#changes >> text=pantry")
    says(page, "#about h2", "pantry")


def test_a_thing_is_never_told_to_be_there_for_certain(own: Served, open_page: OpenPage) -> None:
    own.write(
        "DELETE { ?cup here:existence ?e } INSERT { ?cup here:existence 1e0 } "
        f"WHERE {{ ?cup here:existence ?e FILTER(STRENDS(STR(?cup), '{CUP}')) }}"
    )
    page = open_page(f"#{CUP}", own)
    says(page, "#about", "over 99 % sure")
    page.click("text=All objects")
    says(page, "#objects", "over 99 % sure")


@pytest.mark.parametrize("address", ["", f"#{CUP}", CUP, "place/1", "console"])
def test_a_page_fits_on_a_screen_of_320_pixels(open_page: OpenPage, address: str) -> None:
    page = open_page(address)
    page.set_viewport_size({"width": 320, "height": 640})
    says(page, "body", "")
    assert page.evaluate("document.documentElement.scrollWidth") == 320


def test_names_of_things_are_never_markup(own: Served, open_page: OpenPage) -> None:
    own.map.assertions.add(f"{own.map.base}{CUP}", "label", HOSTILE, by="mallory")
    page = open_page(f"#{CUP}", own)
    says(page, "#about h2", HOSTILE)
    page.click("text=All objects")
    says(page, "#objects", HOSTILE)
    assert page.locator("main img").count() == 0


def test_a_search_is_shared_and_ends_with_the_next_one(open_page: OpenPage) -> None:
    page = open_page()
    page.fill("#wanted", "cup")
    page.click("#find button")
    says(page, "#plan ol", "look 1")
    says(page, "#plan ol", "cup 1 is in the map")
    says(page, "#about h2", "cup 1")  # what is found is selected
    page.wait_for_url(re.compile("find=cup"))
    page.reload()
    says(page, "#plan ol", "look 1")
    assert page.input_value("#wanted") == "cup"
    page.fill("#wanted", "no such thing at all")
    page.click("#find button")
    page.wait_for_selector("#plan ol", state="detached")
    says(page, "#plan", "no such thing")


def test_of_two_searches_in_a_row_the_last_one_is_answered(serve, flat, open_page):
    begun, go_on = threading.Event(), threading.Event()

    def slowly(wanted: list[str]) -> Mapping[str, object]:
        if wanted == ["cup"]:
            begun.set()
            assert go_on.wait(60)
        return plan_words(flat, wanted).to_json()

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


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_has_no_fault_of_accessibility(scheme, eventful, open_page):
    pytest.importorskip("axe_playwright_python")
    page = open_page(f"#{CUP}", eventful, color_scheme=scheme, bypass_csp=True)
    says(page, "#about-history", "appeared")
    for step in ("#earlier", "#compare"):
        page.wait_for_selector(f"{step}:enabled")
        page.click(step)
    says(page, "#changes", "From")
    assert faults(page) == []
    page.click("#solid")
    assert faults(page) == []


def test_a_phone_shows_the_map_first_and_keeps_it(open_page: OpenPage) -> None:
    page = open_page(viewport={"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.locator("#canvas").bounding_box()["width"] > 300
    top, field = (page.locator(one).bounding_box()["y"] for one in ("#canvas", "#wanted"))
    assert top < 20 < field < 844
    page.click("text=All objects")
    page.evaluate("document.querySelector('#objects li:last-child').scrollIntoView()")
    assert page.locator("#canvas").bounding_box()["y"] >= 0
    compare = page.locator("#compare").bounding_box()
    assert compare["x"] + compare["width"] <= 390
    open_menu(page, "layers")
    last = page.locator("#legend li:last-child")
    last.scroll_into_view_if_needed()
    low, end = (one.bounding_box() for one in (last, page.locator("#map")))
    assert low["y"] + low["height"] <= end["y"] + end["height"]


def test_a_shared_address_brings_everything_back(eventful: Served, open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}", eventful)
    says(page, "#about h2", "cup 1")
    page.wait_for_selector("#earlier:enabled")
    page.click("#compare")
    page.click("#earlier")
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
    other = open_page(address.removeprefix("/"), eventful)
    says(other, "#about h2", "cup 1")
    says(other, "#count", "1 of 2 objects")
    says(other, "#changes", "Gone (1)")
    assert "transaction 1 of" in other.locator("#moment").get_attribute("title")
    assert not other.is_checked("[data-layer=labels]")
    assert other.is_checked("[data-layer=viewed]")
    other.wait_for_url(re.compile(r"view=.*filter=cup"))
    assert other.evaluate("location.hash") == page.evaluate("location.hash")


def test_an_empty_map_says_what_to_do(open_page: OpenPage) -> None:
    with in_memory_map() as nothing, MapServer(nothing, SMALL) as server:
        page = open_page(of=server)
        says(page, "#empty", "hereabouts map")
        assert page.is_visible("#empty")
        assert not page.is_visible("#edit"), "nobody may edit"
        page.close()


def test_shapes_of_what_is_shown_are_saved(open_page: OpenPage) -> None:
    page = open_page("#?filter=cup")
    says(page, "#count", "1 of 2 objects")
    open_menu(page, "more")
    with page.expect_download() as saved:
        page.click("#exports >> text=GeoJSON")
    cup, kitchen = json.loads(saved.value.path().read_bytes())["features"]
    assert cup["geometry"] == {"type": "Point", "coordinates": [1, 0.5]}
    assert len(kitchen["geometry"]["coordinates"][0]) == 5


def test_the_page_of_an_object_has_its_place_reasons_and_history(open_page: OpenPage) -> None:
    page = open_page("object/1")
    says(page, "h1", "cup 1")
    says(page, "#about-why", "cup 1 is a cup")
    says(page, "#about-history", "appeared")
    says(page, "#about dl", "in the kitchen")
    assert page.locator("#canvas").bounding_box()["height"] > 200
    assert not page.is_visible("table.facts >> nth=0")
    page.click("summary:has-text('Facts') >> nth=0")
    assert page.is_visible("table.facts >> nth=0")
    page.click("text=show it on the map")
    says(page, "#about h2", "cup 1")


def test_the_page_of_a_thing_follows_what_happens_to_it(own: Served, open_page: OpenPage) -> None:
    page = open_page("object/1", own)
    says(page, "#about-history", "appeared")
    own.map.assertions.add(f"{own.map.base}object/1", "label", "the blue mug", by="ann")
    says(page, "h1", "the blue mug")
    own.map.apply(MapUpdate(removed=(f"{own.map.base}object/1",)))
    says(page, "#status", "no longer in the map")
    assert "in the kitchen" in page.inner_text("#about dl")


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
