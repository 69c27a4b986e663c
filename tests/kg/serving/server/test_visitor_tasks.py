"""Tasks of visitors in a real browser, with as many acts as docs/how-to/map-page.md says."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from kg.model.records import MapUpdate
from planner.questions.answers import answer_box
from tests.kg.serving.server.browser_pages import OpenPage, says

if TYPE_CHECKING:
    from conftest import Served

    from kg.maps.semantic_map import SemanticMap

PAGE = Path(__file__).resolve().parents[4] / "docs" / "how-to" / "map-page.md"
TASKS = {
    task: int(acts)
    for task, acts in re.findall(r"^\| (\w[^|]+?) \| (\d+) \|", PAGE.read_text(), re.M)
}
CUP, CHAIR, FLOOR = (1.0, 0.5), (2.0, 1.5), (3.5, -0.5)


@pytest.fixture
def served(flat: SemanticMap, serve: Callable[..., Served]) -> Served:
    return serve(planner=partial(answer_box, flat))


class Visitor:
    """Who uses a page by mouse and keyboard; each click, key, text or drag is one act."""

    def __init__(self, page: Any, served: Served) -> None:
        self.page, self.served, self.acts = page, served, 0

    def click(self, selector: str) -> None:
        self.acts += 1
        self.page.click(selector)

    def click_at(self, *point: float) -> None:
        """Click at a point [m] of the flat map, of which all is shown: 5 x 4 m around (1.5, 1)."""
        self.acts += 1
        box = self.page.locator("#canvas").bounding_box()
        scale = min((box["width"] - 112) / 5.4, (box["height"] - 60) / 4.4, 250)
        u, v = ((point[0] - 1.5) * scale, (1.0 - point[1]) * scale)
        self.page.mouse.click(box["x"] + box["width"] / 2 + u, box["y"] + box["height"] / 2 + v)

    def write(self, selector: str, text: str) -> None:
        self.acts += 1
        self.page.fill(selector, text)

    def press(self, selector: str, key: str) -> None:
        self.acts += 1
        self.page.press(selector, key)

    def drag(self, selector: str, value: object) -> None:
        self.acts += 1
        self.page.locator(selector).fill(str(value))

    def unlock(self) -> None:
        """Give the token for corrections."""
        self.click("#edit")
        self.write("#token", self.served.bearer()["Authorization"].removeprefix("Bearer "))
        self.press("#token", "Enter")
        self.says("#status", "corrections are open")

    def open_console(self) -> None:
        self.click("#more > summary")
        self.click("text=Ask in SPARQL")
        self.page.wait_for_selector("html[data-ready] #in-words")

    def says(self, selector: str, text: str) -> None:
        says(self.page, selector, text)

    def picture(self) -> Any:
        """The map as it looks, (H, W, 3) uint8 BGR."""
        data = np.frombuffer(self.page.locator("#canvas").screenshot(), np.uint8)
        return cv2.imdecode(data, cv2.IMREAD_COLOR)

    def save(self, kind: str) -> bytes:
        self.click("#more > summary")
        with self.page.expect_download() as saved:
            self.click(f"#exports >> text={kind}")
        return bytes(saved.value.path().read_bytes())


@pytest.fixture
def visitor(request: pytest.FixtureRequest, served: Served, open_page: OpenPage) -> Any:
    """A visitor of the page, whose acts are counted and compared with the documented ones."""
    task = request.node.name.removeprefix("test_").replace("_", " ")
    served.put(3, "bowl", 3.0, 2.5)
    someone = Visitor(open_page(), served)
    someone.says("#count", "3 of 3 objects")
    someone.page.wait_for_selector("#earlier:enabled")
    yield someone
    assert someone.acts == TASKS[task]


def test_where_is_the_cup(visitor: Visitor) -> None:
    visitor.write("#wanted", "cup")
    visitor.press("#wanted", "Enter")
    visitor.says("#plan", "cup 1")
    visitor.says("#about h2", "cup 1")
    visitor.says("#about dl", "in the kitchen")


def test_where_could_an_apple_be(visitor: Visitor) -> None:
    visitor.write("#wanted", "apple")
    visitor.press("#wanted", "Enter")
    visitor.says("#plan", "No apple is in the map")
    visitor.says("#plan ol", "look 1")


def test_what_is_in_the_kitchen(visitor: Visitor) -> None:
    visitor.write("#wanted", "what is in the kitchen?")
    visitor.press("#wanted", "Enter")
    visitor.says("#plan h2", "3 objects")


def test_which_things_are_in_this_room(visitor: Visitor) -> None:
    visitor.click_at(*FLOOR)
    for name in ("cup 1", "chair 2", "bowl 3"):
        visitor.says("#about", name)


def test_what_is_this_thing(visitor: Visitor) -> None:
    visitor.click_at(*CHAIR)
    visitor.says("#about h2", "chair 2")
    visitor.says("#about dl", "seen")


def test_why_does_the_map_have_it(visitor: Visitor) -> None:
    visitor.click_at(*CUP)
    visitor.click("#about-why summary")
    visitor.says("#about-why", "cup 1 is a cup")


def test_read_where_a_statement_comes_from(visitor: Visitor) -> None:
    visitor.click_at(*CUP)
    visitor.click("text=Open its page")
    visitor.click(".source summary >> nth=0")
    visitor.says(".source[open]", "is a cup")


def test_what_changed_since_then(visitor: Visitor) -> None:
    visitor.click("#earlier")
    visitor.says("#count", "2 of 2 objects")
    visitor.click("#compare")
    visitor.says("#changes", "No thing came")
    visitor.click("#now")
    visitor.says("#changes", "Appeared (1)")


def test_which_things_are_gone(visitor: Visitor) -> None:
    visitor.served.map.apply(MapUpdate(removed=(f"{visitor.served.map.base}object/2",)))
    visitor.says("#count", "2 of 2 objects")
    visitor.click("#earlier")
    visitor.says("#moment", ":")
    visitor.click("#compare")
    visitor.says("#changes", "From")
    visitor.click("#now")
    visitor.says("#changes", "Gone (1)")


def test_how_was_it_before(visitor: Visitor) -> None:
    visitor.drag("#time", 0)
    visitor.says("#moment", ":")  # a time
    visitor.says("#count", "0 of 0 objects")


def test_share_what_is_shown(visitor: Visitor, open_page: OpenPage) -> None:
    visitor.click_at(*CUP)
    visitor.says("#about h2", "cup 1")
    visitor.page.wait_for_url("**/#object/1*")
    other = open_page(visitor.page.url.removeprefix(visitor.served.url))
    says(other, "#about h2", "cup 1")


def test_see_the_room_in_three_dimensions(visitor: Visitor) -> None:
    flat = visitor.picture()
    visitor.click("#solid")
    assert visitor.page.get_attribute("#solid", "aria-pressed") == "true"
    visitor.page.wait_for_url("**solid=1*")
    assert (visitor.picture() != flat).mean() > 0.05


def test_see_one_thing_alone(visitor: Visitor) -> None:
    visitor.click_at(*CUP)
    visitor.says("#about h2", "cup 1")
    visitor.click("#focus")
    visitor.page.wait_for_url("**focus=1*")
    assert visitor.page.get_attribute("#focus", "aria-pressed") == "true"


def test_measure_a_distance(visitor: Visitor) -> None:
    visitor.click("#measure")
    visitor.click_at(0.0, 2.0)
    visitor.says("#status", "second point")
    visitor.click_at(3.0, 2.0)
    visitor.says("#status", "m apart")
    metres = float(visitor.page.inner_text("#status").split(" m apart")[0])
    assert metres == pytest.approx(3.0, abs=0.03)


def test_show_only_the_cups(visitor: Visitor) -> None:
    visitor.click("#layers > summary")
    visitor.click("#legend >> text=cup")
    visitor.says("#count", "1 of 3 objects")


def test_save_a_picture(visitor: Visitor) -> None:
    data = np.frombuffer(visitor.save("PNG"), np.uint8)
    saved = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert np.abs(np.subtract(saved.shape, visitor.picture().shape)).max() <= 1
    assert len(np.unique(saved.reshape(-1, 3), axis=0)) > 20


def test_save_a_table(visitor: Visitor) -> None:
    assert b"bowl 3" in visitor.save("CSV")


def test_rename_a_room(visitor: Visitor) -> None:
    visitor.unlock()
    visitor.click_at(*FLOOR)
    visitor.says("#about h2", "the kitchen")
    visitor.write("[aria-label=name]", "galley")
    visitor.click("text=rename")
    visitor.says("#about h2", "galley")
    (place,) = visitor.served.map.places()
    assert place.label == "galley"


def test_split_a_room(visitor: Visitor) -> None:
    visitor.unlock()
    visitor.click_at(*FLOOR)
    visitor.click("text=split")
    visitor.says("#status", "click two points")
    visitor.click_at(1.5, -0.8)
    visitor.click_at(1.5, 2.8)
    visitor.says("#count", "2 places")


def test_rename_a_thing_and_undo_it(visitor: Visitor) -> None:
    visitor.unlock()
    visitor.click_at(*CHAIR)
    visitor.write("[aria-label=name]", "the throne")
    visitor.click("text=rename")
    visitor.says("#about h2", "the throne")
    visitor.click("text=undo my last edit")
    visitor.says("#about h2", "chair 2")
    assert visitor.served.map.assertions.all() == ()


def test_run_a_query_and_sort_its_rows(visitor: Visitor) -> None:
    visitor.open_console()
    visitor.click("#form >> text=Ask")
    visitor.click("#table th >> text=y")
    assert visitor.page.locator("#table td.number:last-child").all_inner_texts()[0] == "0.5"


def test_see_the_query_behind_a_question(visitor: Visitor) -> None:
    visitor.open_console()
    visitor.write("#words", "what is in the kitchen?")
    visitor.press("#words", "Enter")
    visitor.says("#table", "bowl 3")
    visitor.says(".cm-content", "here:inPlace")


def test_say_that_a_thing_is_not_there(visitor: Visitor) -> None:
    visitor.unlock()
    visitor.click_at(*CHAIR)
    visitor.says("#about h2", "chair 2")
    visitor.click("text=it is not there")
    visitor.says("#status", "existence: absent")
    (made,) = visitor.served.map.assertions.all(f"{visitor.served.map.base}object/2")
    assert (made.property, made.value) == ("existence", "absent")


def test_each_documented_task_is_tested() -> None:
    tested = {name.removeprefix("test_").replace("_", " ") for name in globals()}
    assert len(TASKS) >= 15
    assert TASKS.keys() <= tested
