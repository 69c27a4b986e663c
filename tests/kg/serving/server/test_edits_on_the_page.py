"""What people change on the live map, in a real browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.kg.serving.server.browser_pages import OpenPage, click_map, says, unlock
from tests.kg.serving.server.conftest import TOKEN

if TYPE_CHECKING:
    from conftest import Served

CUP = "object/1"


def test_a_correction_lands_in_the_graph_and_on_other_pages(own, open_page):
    page, other = open_page(f"#{CUP}", own), open_page("", own)
    other.click("text=All objects")
    unlock(page, "not-the-token-at-all")
    says(page, "#status", "this token may not write")
    assert page.locator("text=it is not there").count() == 0
    page.fill("#token", TOKEN)
    page.click("#corrector button")
    page.fill("[aria-label=name]", "the blue mug")
    page.click("text=rename")
    says(other, "#objects", "the blue mug")
    (made,) = own.map.assertions.all(f"{own.map.base}{CUP}")
    assert (made.property, made.value, made.by) == ("label", "the blue mug", "ann")
    page.click("text=undo")
    says(other, "#objects", "cup 1")
    assert own.map.assertions.all() == ()
    kept = page.evaluate("JSON.stringify([location.href, {...localStorage}, {...sessionStorage}])")
    assert TOKEN not in kept
    page.click("text=move >> nth=0")
    click_map(page, 60.0)
    says(page, "#status", "position: ")
    (moved,) = own.map.assertions.all(f"{own.map.base}{CUP}")
    assert moved.property == "position"


def test_a_token_that_is_refused_later_is_asked_for_again(own: Served, open_page: OpenPage) -> None:
    page = open_page(f"#{CUP}", own)
    unlock(page, TOKEN)
    page.wait_for_selector("[aria-label=name]")
    page.evaluate(
        "async () => (await import('/files/server.js')).useToken('one-of-yesterday-0123')"
    )
    page.click("text=rename")
    says(page, "#status", "may not write")
    page.fill("#token", TOKEN)
    page.click("#corrector button")
    page.fill("[aria-label=name]", "the blue mug")
    page.click("text=rename")
    says(page, "#about h2", "the blue mug")


def test_rooms_are_edited_by_mouse_and_keyboard(own, flat, open_page):
    page = open_page("#place/1", own)
    unlock(page, TOKEN)
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
            click_map(page, (u - x) * scale, (v - y) * scale)

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
