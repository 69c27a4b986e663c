"""Tasks of visitors in a real browser, with as many acts as docs/how-to/map-page.md says."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from kg.model.records import MapUpdate
from tests.kg.serving.server.browser_pages import OpenPage, click_map, other_picture, picture, says
from tests.kg.serving.server.conftest import TOKEN, answering, furnished, page_opener

if TYPE_CHECKING:
    from conftest import Served

PAGE = Path(__file__).resolve().parents[4] / "docs" / "how-to" / "map-page.md"
TASKS = {
    task: int(acts)
    for task, acts in re.findall(r"^\| (\w[^|]+?) \| (\d+) \|", PAGE.read_text(), re.M)
}
#: a name of two directions of writing, with markup, and longer than any line
NAMES = "<b>cup</b> \u05db\u05d5\u05e1 " + "of-all-cups-" * 6
CUP, CHAIR, FLOOR = (1.0, 0.5), (2.0, 1.5), (3.5, -0.5)


@pytest.fixture(scope="module")
def shown() -> Iterator[Served]:
    """A flat into which a bowl came, for the tasks that change nothing."""
    with furnished() as semantic_map, answering(semantic_map) as served:
        served.put(3, "bowl", 3.0, 2.5)
        yield served


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
        click_map(self.page, (point[0] - 1.5) * scale, (point[1] - 1.0) * scale)

    def write(self, selector: str, text: str) -> None:
        self.acts += 1
        self.page.fill(selector, text)

    def ask(self, selector: str, text: str) -> None:
        self.write(selector, text)
        self.acts += 1
        self.page.press(selector, "Enter")

    def unlock(self) -> None:
        """Give the token for corrections."""
        self.click("#edit")
        self.ask("#token", TOKEN)
        self.says("#status", "corrections are open")

    def open_console(self) -> None:
        self.click("#more > summary")
        self.click("text=Ask in SPARQL")
        self.page.wait_for_selector("html[data-ready] #in-words")

    def says(self, selector: str, text: str) -> None:
        says(self.page, selector, text)

    def save(self, kind: str) -> bytes:
        self.click("#more > summary")
        with self.page.expect_download() as saved:
            self.click(f"#exports >> text={kind}")
        return bytes(saved.value.path().read_bytes())


def counted(request: pytest.FixtureRequest, someone: Visitor) -> Iterator[Visitor]:
    """A visitor, whose acts are those that the task is documented with."""
    someone.page.wait_for_selector("#earlier:enabled")
    yield someone
    given = getattr(request.node, "callspec", None)
    name = given.params["task"] if given else request.node.name.removeprefix("test_")
    assert someone.acts == TASKS[name.replace("_", " ")]


@pytest.fixture(scope="module")
def standing(request: pytest.FixtureRequest) -> Iterator[Any]:
    """A page that stays open."""
    with page_opener(request) as opened:
        yield opened()


@pytest.fixture
def visitor(request: pytest.FixtureRequest, shown: Served, standing: Any) -> Iterator[Visitor]:
    """A visitor of the map that the tasks share, whose page shows it as at first."""
    standing.keyboard.press("Escape")
    standing.goto(f"{shown.url}#?age=")  # a parameter without a value: all are as at first
    standing.wait_for_selector("html[data-ready]")
    says(standing, "#about", "Ask a question")
    says(standing, "#count", "3 of 3")
    says(standing, "#moment", "now")
    standing.click("#fit")
    yield from counted(request, Visitor(standing, shown))


@pytest.fixture
def editor(request: pytest.FixtureRequest, own: Served, open_page: OpenPage) -> Iterator[Visitor]:
    """A visitor of a map of one's own, which the task changes."""
    yield from counted(request, Visitor(open_page("", own), own))


#: tasks that leave the map as it is: what a visitor does, and then reads in elements of the page
READ: dict[str, list[tuple[Any, ...] | dict[str, str]]] = {
    "where is the cup": [
        ("ask", "#wanted", "cup"),
        {"#plan": "cup 1", "#about h2": "cup 1", "#about dl": "in the kitchen"},
    ],
    "where could an apple be": [
        ("ask", "#wanted", "apple"),
        {"#plan": "No apple is in the map", "#plan ol": "look 1"},
    ],
    "what is in the kitchen": [
        ("ask", "#wanted", "what is in the kitchen?"),
        {"#plan h2": "3 objects"},
    ],
    "which things are in this room": [
        ("click_at", *FLOOR),
        {f"#about li >> text={name}": name for name in ("cup 1", "chair 2", "bowl 3")},
    ],
    "what is this thing": [("click_at", *CHAIR), {"#about h2": "chair 2", "#about dl": "seen"}],
    "why does the map have it": [
        ("click_at", *CUP),
        ("click", "#about-why summary"),
        {"#about-why": "cup 1 is a cup"},
    ],
    "what changed since then": [
        ("click", "#earlier"),
        {"#count": "2 of 2 objects"},
        ("click", "#compare"),
        {"#changes": "No thing came"},
        ("click", "#now"),
        {"#changes": "Appeared (1)"},
    ],
    "how was it before": [("write", "#time", "0"), {"#moment": ":", "#count": "0 of 0 objects"}],
    "see one thing alone": [
        ("click_at", *CUP),
        {"#about h2": "cup 1"},
        ("click", "#focus"),
        {"#focus[aria-pressed=true]": "◎"},
    ],
    "show only the cups": [
        ("click", "#layers > summary"),
        ("click", "#legend >> text=cup"),
        {"#count": "1 of 3 objects"},
    ],
    "read where a statement comes from": [
        ("click_at", *CUP),
        ("click", "text=Open its page"),
        ("click", ".source summary >> nth=0"),
        {".source[open]": "is a cup"},
    ],
    "begin with a question that the page offers": [
        ("click", "#about .examples button >> nth=1"),
        {"#plan h2": "3 objects"},
    ],
    "ask again where a question is refused": [
        ("ask", "#wanted", "flurb the gronk"),
        {"#plan": "These would work"},
        ("click", "#plan .examples button >> text=which rooms"),
        {"#plan": "the kitchen"},
    ],
    "copy the IRI of a thing": [
        ("click_at", *CUP),
        ("click", "text=Open its page"),
        ("click", ".whole"),
        {".whole": "/object/1"},
    ],
    "see the query behind a question": [
        ("open_console",),
        ("ask", "#words", "what is in the kitchen?"),
        {"#table": "bowl 3", ".cm-content": "here:inPlace"},
    ],
}


@pytest.mark.parametrize("task", READ)
def test_tasks_that_are_read_from_the_page(task: str, visitor: Visitor) -> None:
    for step in READ[task]:
        if isinstance(step, dict):
            for place, text in step.items():
                visitor.says(place, text)
        else:
            getattr(visitor, step[0])(*step[1:])


def test_which_things_are_gone(editor: Visitor) -> None:
    editor.served.map.apply(MapUpdate(removed=(f"{editor.served.map.base}object/2",)))
    editor.says("#count", "1 of 1 objects")
    editor.click("#earlier")
    editor.says("#moment", ":")
    editor.click("#compare")
    editor.says("#changes", "From")
    editor.click("#now")
    editor.says("#changes", "Gone (1)")


def test_share_what_is_shown(visitor: Visitor, open_page: OpenPage) -> None:
    visitor.click_at(*CUP)
    visitor.says("#about h2", "cup 1")
    visitor.page.wait_for_url("**/#object/1*")
    other = open_page(visitor.page.url.removeprefix(visitor.served.url))
    says(other, "#about h2", "cup 1")


def test_see_the_room_in_three_dimensions(visitor: Visitor) -> None:
    flat = picture(visitor.page)
    visitor.click("#solid")
    assert visitor.page.get_attribute("#solid", "aria-pressed") == "true"
    visitor.page.wait_for_url("**solid=1*")
    assert (other_picture(visitor.page, flat) != flat).mean() > 0.05


def test_measure_a_distance(visitor: Visitor) -> None:
    visitor.click("#measure")
    visitor.click_at(0.0, 2.0)
    visitor.says("#status", "second point")
    visitor.click_at(3.0, 2.0)
    visitor.says("#status", "m apart")
    metres = float(visitor.page.inner_text("#status").split(" m apart")[0])
    assert metres == pytest.approx(3.0, abs=0.03)


def test_save_a_picture(visitor: Visitor) -> None:
    data = np.frombuffer(visitor.save("PNG"), np.uint8)
    saved = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert np.abs(np.subtract(saved.shape, picture(visitor.page).shape)).max() <= 1
    assert len(np.unique(saved.reshape(-1, 3), axis=0)) > 20


def test_save_a_table(visitor: Visitor) -> None:
    saved = visitor.save("CSV").decode()
    cup = next(row for row in csv.DictReader(io.StringIO(saved)) if row["name"] == "cup 1")
    assert (float(cup["x"]), cup["place"]) == (1.0, "the kitchen")


def test_rename_a_room(editor: Visitor) -> None:
    editor.unlock()
    editor.click_at(*FLOOR)
    editor.says("#about h2", "the kitchen")
    editor.write("[aria-label=name]", "galley")
    editor.click("text=rename")
    editor.says("#about h2", "galley")
    (place,) = editor.served.map.places()
    assert place.label == "galley"


def test_split_a_room(editor: Visitor) -> None:
    editor.unlock()
    editor.click_at(*FLOOR)
    editor.click("text=split")
    editor.says("#status", "click two points")
    editor.click_at(1.5, -0.8)
    editor.click_at(1.5, 2.8)
    editor.says("#count", "2 places")


def test_rename_a_thing_and_undo_it(editor: Visitor) -> None:
    editor.unlock()
    editor.click_at(*CHAIR)
    editor.write("[aria-label=name]", "the throne")
    editor.click("text=rename")
    editor.says("#about h2", "the throne")
    editor.click("text=undo my last edit")
    editor.says("#about h2", "chair 2")
    assert editor.served.map.assertions.all() == ()


def test_correct_a_name_that_stays(editor: Visitor) -> None:
    editor.unlock()
    editor.click_at(*CUP)
    editor.write("[aria-label=name]", NAMES)
    editor.click("text=rename")
    editor.says("#about h2", NAMES[:40])
    editor.page.reload()
    editor.says("#about h2", NAMES[:40])
    assert editor.page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_go_from_three_dimensions_to_the_page_of_a_thing_and_back(visitor: Visitor) -> None:
    visitor.click_at(*CUP)
    visitor.click("#solid")
    visitor.page.wait_for_url("**solid=1*")
    visitor.click("text=Open its page")
    visitor.says("h1", "cup 1")
    visitor.click("text=← the map")
    visitor.page.wait_for_selector("#solid[aria-pressed=true]")
    visitor.says("#about h2", "cup 1")


def test_run_a_query_and_sort_its_rows(visitor: Visitor) -> None:
    visitor.open_console()
    visitor.click("#form >> text=Ask")
    visitor.click("#table th >> text=y")
    assert visitor.page.locator("#table td.number:last-child").all_inner_texts()[0] == "0.5"


def test_say_that_a_thing_is_not_there(editor: Visitor) -> None:
    editor.unlock()
    editor.click_at(*CHAIR)
    editor.says("#about h2", "chair 2")
    editor.click("text=it is not there")
    editor.says("#status", "existence: absent")
    (made,) = editor.served.map.assertions.all(f"{editor.served.map.base}object/2")
    assert (made.property, made.value) == ("existence", "absent")


def test_each_documented_task_is_tested() -> None:
    tested = {name.removeprefix("test_").replace("_", " ") for name in globals()}
    assert len(TASKS) >= 15
    assert TASKS.keys() == tested & TASKS.keys() | READ.keys()
