"""Things without a name on the page's map: faint outlines that a click selects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import ObjectPictures
from kg.model import vocabulary as v
from kg.model.records import SURFACE, Evidence, MapUpdate
from kg.serving.opening import create_map
from tests.kg.serving.server.browser_pages import OpenPage, says, show_layer
from tests.kg.serving.server.conftest import BASE, TOKEN, thing

if TYPE_CHECKING:
    from conftest import Served

    from kg.maps.semantic_map import SemanticMap
    from kg.model.records import ObjectRecord

THING = "object/7"


def unnamed(semantic_map: SemanticMap) -> ObjectRecord:
    """A thing without a name in the middle of the kitchen."""
    seen = Evidence("frame-1", "flat", 1.7e9, (1.0, 2.0, 3.0, 4.0), 0.9, SURFACE)
    return replace(
        thing(semantic_map, 7, "cup", 1.5, 1.0),
        category=v.UNNAMED_THING,
        extent=np.array([0.6, 0.3, 0.2]),
        yaw=0.4,
        evidence=seen,
    )


@pytest.fixture
def served(flat: SemanticMap, serve: Callable[..., Served]) -> Served:
    flat.apply(MapUpdate(objects=(unnamed(flat),)))
    return serve()


def click_the_middle(page: Any) -> None:
    box = page.locator("#canvas").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def drawn(page: Any) -> bytes:
    """The picture of the map, as soon as it rests."""
    last = None
    while True:
        page.wait_for_timeout(200)
        page.wait_for_selector("#canvas[data-drawn=smoothly]")
        now = bytes(page.locator("#canvas").screenshot())
        if now == last:
            return now
        last = now


@pytest.mark.parametrize("is_flat", [True, False])
def test_a_thing_without_a_name_is_an_outline_that_a_click_selects(
    is_flat: bool, served: Served, open_page: OpenPage
) -> None:
    page = open_page()
    says(page, "#count", "2 of 2 objects")  # not in the list
    page.click("text=All objects")
    assert "unnamed" not in page.locator("#objects").inner_text()
    if not is_flat:
        page.click("#solid")
        page.evaluate("location.hash = 'object/7'")  # which flies there
        says(page, "#about h2", "unnamed thing")
        page.evaluate("location.hash = ''")
        says(page, "#about", "Nothing is selected")
    page.mouse.move(1, 1)
    outlined = drawn(page)
    show_layer(page, "things", False)
    assert drawn(page) != outlined
    show_layer(page, "things", True)
    assert drawn(page) == outlined
    click_the_middle(page)
    says(page, "#about h2", "unnamed thing")
    says(page, "#about dl", "20 cm high")


def test_a_name_given_on_the_page_makes_it_an_object(served: Served, open_page: OpenPage) -> None:
    page, other = open_page(f"#{THING}"), open_page()
    page.click("#edit")
    page.fill("#token", TOKEN)
    page.click("#corrector button")
    page.fill("[aria-label=category]", "bottle")
    page.click("text=is a")
    for one in (page, other):
        says(one, "#count", "3 of 3 objects")
    says(page, "#about dl", "bottle")
    page.click("text=undo")
    says(other, "#count", "2 of 2 objects")
    other.evaluate("location.hash = 'object/7'")
    says(other, "#about h2", "unnamed thing")


def test_the_past_has_the_things_of_that_time(served: Served) -> None:
    now = served.get("state").json()
    assert [one["iri"] for one in now["things"]] == [THING]
    assert now["things"][0]["dx"] == 0.6 and "class" not in now["things"][0]
    past = served.get("state", params={"at": served.map.sequence - 1}).json()
    assert past["things"] == [] and past["objects"] == now["objects"]
    assert "things" not in served.get("state", params={"objects": "0"}).json()


def test_a_selected_thing_has_its_picture(
    tmp_path: Path, on_disk: Callable[..., Any], open_page: OpenPage
) -> None:
    folder = tmp_path / "flat.map"
    with create_map(folder, base=BASE) as semantic_map:
        record = unnamed(semantic_map)
        semantic_map.apply(MapUpdate(objects=(record,)))
        violet = np.full((40, 60, 3), (220, 20, 200), np.uint8)
        ObjectPictures(folder).write(record, cv2.imencode(".jpg", violet)[1].tobytes())
    with on_disk(folder) as other:
        page = open_page(f"#{THING}", of=other)
        page.wait_for_selector("#about [aria-label='unnamed thing 7 as it was seen best']")
        page.close()
