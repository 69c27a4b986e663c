"""Things without a name on the page's map: faint outlines that a click selects."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
from tests.kg.serving.server.browser_pages import (
    OpenPage,
    click_map,
    go_to,
    other_picture,
    picture,
    same_picture,
    says,
    show_layer,
    unlock,
)
from tests.kg.serving.server.conftest import BASE, TOKEN, answering, thing

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
def own(flat: SemanticMap) -> Iterator[Served]:
    flat.apply(MapUpdate(objects=(unnamed(flat),)))
    with answering(flat) as served:
        yield served


def test_a_thing_without_a_name_is_an_outline_that_a_click_selects(
    own: Served, open_page: OpenPage
) -> None:
    page = open_page("", own)
    says(page, "#count", "2 of 2 objects")  # not in the list
    page.click("text=All objects")
    assert "unnamed" not in page.locator("#objects").inner_text()
    for is_flat in (True, False):
        if not is_flat:
            page.click("#solid")
            go_to(page, "")
            says(page, "#about", "Nothing is selected")
            go_to(page, THING)  # which flies there
            says(page, "#about h2", "unnamed thing")
            go_to(page, "")
        says(page, "#about", "Nothing is selected")
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
    now = own.get("state").json()
    assert [one["iri"] for one in now["things"]] == [THING]
    assert now["things"][0]["dx"] == 0.6 and "class" not in now["things"][0]
    past = own.get("state", params={"at": own.map.sequence - 1}).json()
    assert past["things"] == [] and past["objects"] == now["objects"]
    assert "things" not in own.get("state", params={"objects": "0"}).json()


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
        page = open_page(f"#{THING}", other)
        page.wait_for_selector("#about [aria-label='unnamed thing 7 as it was seen best']")
        page.close()
