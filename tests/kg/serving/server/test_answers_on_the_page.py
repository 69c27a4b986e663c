"""Answers of every family on the map page: each is drawn with links, and ends no other mark."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from kg.model.records import MapUpdate, PlaceRecord, RobotRecord
from planner.questions.answers import answer_box
from tests.kg.serving.server.browser_pages import OpenPage, says

if TYPE_CHECKING:
    from conftest import Served

    from kg.maps.semantic_map import SemanticMap

#: question -> what its card says
FAMILIES = {
    "where is the cup?": "in the kitchen",
    "how many chairs are there?": "1",
    "what is in the kitchen?": "2 objects",
    "what is near the chair?": "cup",
    "when was the cup last seen?": "ago",
    "what changed since yesterday?": "Appeared",
    "how far is the cup from the chair?": "1.4 m",
    "which rooms are there?": "1 place",
    "something to sit on": "chair",
}
#: keeps the words that the map's names are drawn with; pictures of them are drawn again and again
WRITTEN = """
    window.written = new Set();
    const { fillText, drawImage } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.fillText = function (text, ...more) {
        this.canvas.words = text;
        return fillText.call(this, text, ...more); };
    CanvasRenderingContext2D.prototype.drawImage = function (picture, ...more) {
        window.written.add(picture.words);
        return drawImage.call(this, picture, ...more); };"""
#: counts the arrows of robots that are drawn
ARROWS = """
    window.arrows = 0;
    const close = CanvasRenderingContext2D.prototype.closePath;
    CanvasRenderingContext2D.prototype.closePath = function () {
        window.arrows++;
        return close.call(this); };"""


@pytest.fixture
def served(flat: SemanticMap, serve: Callable[..., Served]) -> Served:
    return serve(planner=partial(answer_box, flat))


def ask(page: Any, question: str) -> None:
    page.fill("#wanted", question)
    page.press("#wanted", "Enter")
    page.wait_for_selector("#plan h2")


def names_drawn(page: Any, *names: str) -> None:
    """Wait until the map is drawn anew, at rest, with all of the names."""
    page.evaluate("window.written.clear()")
    page.click("#fit")
    drawn = "names => names.every((name) => window.written.has(name))"
    page.wait_for_function(drawn, arg=list(names))


def test_a_question_of_every_family_is_answered_and_all_names_stay(open_page: OpenPage) -> None:
    page = open_page(script=WRITTEN)
    names_drawn(page, "cup", "chair", "the kitchen")
    for question, said in FAMILIES.items():
        ask(page, question)
        says(page, "#plan", said)
        assert page.locator("#plan .link").count() > 0, question
        names_drawn(page, "cup", "chair", "the kitchen")


def test_who_opens_the_shared_address_of_an_answer_has_the_names_too(open_page: OpenPage) -> None:
    page = open_page("#?find=what+is+in+the+kitchen%3F", script=WRITTEN)
    says(page, "#plan", "2 objects")
    names_drawn(page, "cup", "chair", "the kitchen")
    page.click("#plan .link >> text=chair")
    says(page, "#about h2", "chair 2")
    assert not page.is_visible("#plan h2")
    page.click("#back")
    assert page.is_visible("#plan h2")


def test_a_thing_that_is_given_a_new_word_stays(served: Served, open_page: OpenPage) -> None:
    page = open_page("#object/1", script=WRITTEN)
    names_drawn(page, "cup", "chair")
    given = {"thing": "object/1", "property": "name", "value": "gherkin grater"}
    assert served.post("assertions", json=given, headers=served.bearer()).ok
    says(page, "#about dl", "gherkin grater")
    says(page, "#count", "2 of 2 objects")
    names_drawn(page, "gherkin grater", "chair")


def test_one_broken_mark_ends_no_other(open_page: OpenPage, served: Served) -> None:
    broken: list[str] = []
    page = open_page(script=WRITTEN + "window.reportError = (error) => { window.failed = error; };")
    page.on("pageerror", lambda error: broken.append(str(error)))
    page.evaluate("""async () => {
        const { MarkLayer } = await import("/files/mark-layer.js");
        MarkLayer.prototype._drawRobot = () => { throw new Error("a robot without a pose"); }; }""")
    names_drawn(page, "cup", "chair", "the kitchen")
    assert "without a pose" in page.evaluate("String(window.failed)")
    assert broken == []


def test_a_room_is_called_on_the_map_as_in_sentences(served: Served, open_page: OpenPage) -> None:
    served.map.assertions.add(f"{served.map.base}place/1", "label", "place 1", by="ann")
    served.map.assertions.add(f"{served.map.base}place/1", "category", "shower", by="ann")
    page = open_page("#place/1", script=WRITTEN)
    says(page, "#about h2", "bathroom")
    names_drawn(page, "bathroom")
    ask(page, "where is the cup?")
    says(page, "#plan h2", "bathroom")


def test_rooms_are_listed_while_nothing_is_selected(served: Served, open_page: OpenPage) -> None:
    place = PlaceRecord(f"{served.map.base}place/2", "place 2", 5, 6, 0, 1, views=1)
    served.map.apply(MapUpdate(places=(place,)))
    page = open_page()
    says(page, "#about", "the kitchen: 2 objects")
    says(page, "#about", "place 2: 0 objects")
    served.put(3, "bowl", 2.0, 2.0)
    says(page, "#about", "the kitchen: 3 objects")
    page.click("#about .link >> text=place 2")
    says(page, "#about h2", "place 2")


def test_a_map_that_does_not_come_is_asked_for_again_in_words(open_page: OpenPage) -> None:
    page = open_page(
        ready="#state:has-text('trying again')",
        script="""
        const get = window.fetch;
        let failures = 2;
        window.fetch = (address, ...more) => String(address).startsWith("/state") && failures-- > 0
            ? Promise.reject(new TypeError("no connection")) : get(address, ...more);""",
    )
    says(page, "#live", "no connection")
    says(page, "#live", "live")
    says(page, "#count", "2 of 2 objects")


def test_a_busy_server_is_asked_again(open_page: OpenPage) -> None:
    page = open_page(
        script="""
        const get = window.fetch;
        let refusals = 2;
        window.fetch = (address, ...more) => String(address).startsWith("/find") && refusals-- > 0
            ? Promise.resolve(new Response("no time", { status: 503 })) : get(address, ...more);
        window.told = [];
        window.addEventListener("busy", () => setTimeout(() => {
            window.told.push(document.getElementById("state").textContent); }));"""
    )
    ask(page, "what is in the kitchen?")
    says(page, "#plan", "2 objects")
    says(page, "#live", "live")
    assert page.evaluate("window.told[0]").startswith("the server is busy")


def test_a_page_without_connection_says_so_and_follows_again(
    served: Served, open_page: OpenPage
) -> None:
    page = open_page()
    says(page, "#live", "live")
    page.route("**/changes?*", lambda route: route.abort())
    page.evaluate("window.stop()")  # ends the feed
    says(page, "#live", "not connected")
    served.put(3, "bowl", 2.0, 2.0)
    page.unroute("**/changes?*")
    says(page, "#live", "live")
    says(page, "#count", "3 of 3 objects")


def test_a_robot_that_comes_later_is_drawn(served: Served, open_page: OpenPage) -> None:
    page = open_page(script=ARROWS)
    page.click("#fit")
    page.wait_for_selector("#canvas[data-drawn=smoothly]")
    assert page.evaluate("window.arrows") == 0
    robot = RobotRecord(np.array([1.0, 1.0, 0.0]), 0.5, 1.7e9)
    served.map.apply(MapUpdate(robot=robot))
    page.wait_for_function("() => window.arrows > 0")
