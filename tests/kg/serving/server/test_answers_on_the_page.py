"""Answers of every family on the map page: each is drawn with links, and ends no other mark."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from kg.model.records import (
    DepartedRecord,
    DoorRecord,
    MapUpdate,
    PlaceRecord,
    Relation,
    RobotRecord,
)
from tests.kg.serving.server.browser_pages import OpenPage, ask, says

if TYPE_CHECKING:
    from conftest import Served

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


def test_what_comes_later_is_drawn_and_told(own, open_page, monkeypatch):
    # queries are answered from an old snapshot, unless they ask for what came since
    snapshots = own.server.serving.pool._snapshots
    made = snapshots.refresh
    monkeypatch.setattr(snapshots, "_refresh", 3600.0)
    monkeypatch.setattr(
        snapshots,
        "refresh",
        lambda since=None: made(since) if since or snapshots._current is None else None,
    )
    place = PlaceRecord(f"{own.map.base}place/2", "place 2", 5, 6, 0, 1, views=1)
    own.map.apply(MapUpdate(places=(place,)))
    page = open_page("", own, script=WRITTEN + ARROWS)
    says(page, "#about", "the kitchen 2 objects")
    says(page, "#about", "place 2 0 objects")
    own.put(3, "bowl", 2.0, 2.0)
    says(page, "#about", "the kitchen 3 objects")
    page.click("#about .link >> text=place 2")
    says(page, "#about h2", "place 2")
    names_drawn(page, "cup", "chair", "bowl")
    assert page.evaluate("window.arrows") == 0
    own.map.apply(MapUpdate(robot=RobotRecord(np.array([1.0, 1.0, 0.0]), 0.5, 1.7e9)))
    page.wait_for_function("() => window.arrows > 0")
    # a thing that is given a word which the page does not know
    page.evaluate("location.hash = 'object/1'")
    given = {"thing": "object/1", "property": "name", "value": "gherkin grater"}
    assert own.post("assertions", json=given, headers=own.bearer()).ok
    says(page, "#about dl", "gherkin grater")
    says(page, "#count", "3 of 3 objects")
    names_drawn(page, "gherkin grater", "chair")


def test_a_new_answer_ends_the_selection_of_the_one_before(open_page: OpenPage) -> None:
    page = open_page("#object/1")
    says(page, "#about h2", "cup 1")
    ask(page, "which rooms are there?")
    says(page, "#plan", "the kitchen")
    says(page, "#about", "Ask a question")
    page.wait_for_url("**/#?find=*")
    assert "object/1" not in page.url


def test_times_in_sentences_are_told_by_the_clock(open_page: OpenPage) -> None:
    told = open_page().evaluate("""async () => {
        const { cleaned } = await import("/files/answer-panel.js");
        return ["2020-02-03 04:05 UTC", "2020-02-03T04:05:06Z"].map((time) => cleaned(time)); }""")
    assert all(re.fullmatch(r"Feb [23], 2020, \d\d:\d5:0[06]", line) for line in told)


def test_a_name_that_is_too_long_for_the_map_is_shortened(own: Served, open_page: OpenPage) -> None:
    for iri, name in (("place/1", "all cups of the house " * 3), ("object/2", "chair" * 12)):
        own.map.assertions.add(f"{own.map.base}{iri}", "label", name.strip(), by="ann")
    narrow = open_page("", own, script=WRITTEN, viewport={"width": 390, "height": 844})
    names_drawn(narrow, "all cups of the house all c…", "chairchairchairchairchairch…")


def test_the_history_of_a_thing_is_in_sentences(own: Served, open_page: OpenPage) -> None:
    own.move(1, 3.0)
    own.map.assertions.add(f"{own.map.base}object/1", "label", "Ann's mug", by="ann")
    own.move(1, 3.5)
    own.move(1, 2.5)
    page = open_page("object/1", own)
    says(page, "#about-history", "It appeared at (1.00, 0.50) m, 80 % sure, in the kitchen")
    says(page, "#about-history", "It moved 2.00 m to (3.00, 0.50) m")
    says(page, "#about-history", "It moved 1.00 m to (2.50, 0.50) m, after 1 such change")
    says(page, "#about-history", "It is called Ann's mug (ann)")
    says(page, "#about-why", "written at")
    says(page, "#about-why", "from frame-000001 of flat")


def test_what_left_the_map_and_a_door_have_pages_in_sentences(
    own: Served, open_page: OpenPage
) -> None:
    cup, rooms = own.map.objects()[0], (own.map.place_iri(1), own.map.place_iri(2))
    gone = DepartedRecord(cup.iri, cup.category, cup.p_map, 0.8, 3, *3 * [cup.last_seen])
    own.map.apply(MapUpdate(removed=(cup.iri,), departed=(gone,)))
    hall = PlaceRecord(rooms[1], "hall", 4, 6, -1, 3)
    door = DoorRecord(f"{own.map.base}door/1-2", 4.0, 1.0, 0.9, rooms)
    own.map.apply(MapUpdate(places=(hall,), doors=(door,)))
    page = open_page("object/1", own)
    says(page, "#about-why", "cup 1 left (1, 0.5, 0.8) m")
    says(page, "#about-history", "It left where it stood")
    page = open_page("door/1-2", own)
    says(page, "#about-history", "It appeared at (4.00, 1.00) m, leading to the kitchen")
    says(page, "#about-why", "split into rooms at its doors")


def test_many_reasons_and_things_of_one_name_are_told_apart(
    own: Served, open_page: OpenPage
) -> None:
    table, *cups = (
        replace(one, relations=(), iri=f"{own.map.base}object/{n}")
        for n, one in enumerate([*own.map.objects()[1:], *9 * own.map.objects()[:1]], 10)
    )
    on = tuple(replace(one, relations=(Relation("on", table.iri, 0.9),)) for one in cups)
    own.map.apply(MapUpdate(objects=(table, *on)))
    page = open_page("object/10", own)
    says(page, "#about-where", "with cup 11, cup 12, cup 13")
    says(page, "#about-where", "and cup 19 on it")
    for n in range(20):  # changes of what it is, by nobody
        own.put(30, ("cup", "chair")[n % 2], 1.0 + n, 0.5)
    page = open_page("object/30", own)
    says(page, "#about-history", "after 18 such changes")


def test_one_broken_mark_ends_no_other(open_page: OpenPage) -> None:
    broken: list[str] = []
    page = open_page(script=WRITTEN + "window.reportError = (error) => { window.failed = error; };")
    page.on("pageerror", lambda error: broken.append(str(error)))
    page.evaluate("""async () => {
        const { MarkLayer } = await import("/files/mark-layer.js");
        MarkLayer.prototype._drawRobot = () => { throw new Error("a robot without a pose"); }; }""")
    names_drawn(page, "cup", "chair", "the kitchen")
    assert "without a pose" in page.evaluate("String(window.failed)")
    assert broken == []


def test_a_room_is_called_on_the_map_as_in_sentences(own: Served, open_page: OpenPage) -> None:
    own.map.assertions.add(f"{own.map.base}place/1", "label", "place 1", by="ann")
    own.map.assertions.add(f"{own.map.base}place/1", "category", "shower", by="ann")
    page = open_page("#place/1", own, script=WRITTEN)
    says(page, "#about h2", "bathroom")
    names_drawn(page, "bathroom")
    ask(page, "where is the cup?")
    says(page, "#plan h2", "bathroom")


def test_a_map_that_does_not_come_is_asked_for_again_in_words(open_page: OpenPage) -> None:
    page = open_page(
        ready="#state:has-text('trying again')",
        script="""
        const get = window.fetch;
        let failures = 2;
        window.fetch = (address, ...more) => String(address).startsWith("/state") && failures-- > 0
            ? Promise.reject(new TypeError("no connection")) : get(address, ...more);""",
    )
    says(page, "#live", "the server does not answer")
    says(page, "#live", "live")
    says(page, "#count", "2 of 2 objects")


def test_a_question_without_an_answer_is_asked_again_with_the_next_connection(
    open_page: OpenPage,
) -> None:
    page = open_page(
        "#?find=where+is+the+cup%3F",
        script="""
        const get = window.fetch, lost = new Set(["/find", "/changes"]);
        window.fetch = (address, ...more) => lost.delete(String(address).split("?")[0])
            ? Promise.reject(new TypeError("no connection")) : get(address, ...more);""",
    )
    says(page, "#plan", "the server does not answer")
    says(page, "#plan h2", "kitchen")


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


def test_a_page_without_connection_says_so_and_follows_again(own, open_page):
    page = open_page("", own)
    says(page, "#live", "live")
    page.route("**/changes?*", lambda route: route.abort())
    page.evaluate("window.stop()")  # ends the feed
    says(page, "#live", "not connected")
    own.put(3, "bowl", 2.0, 2.0)
    page.unroute("**/changes?*")
    says(page, "#live", "live")
    says(page, "#count", "3 of 3 objects")
